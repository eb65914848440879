"""Keys of a scene that are no parameters of a calculation: the one table of their names, types and meanings.

The checks take the names from here, the reference of the scene file names, types and meanings.
"""

from collections.abc import Mapping
from typing import Any, Literal

from voxgran._base.config import parameter, parameter_class, parameters_of


@parameter_class
class AnyShape:
    """Keys of every [[shape]]."""

    share: float = parameter(1.0, doc="share of the grains that have this shape", at_least=0.0)
    density: float | None = parameter(
        None, doc="density of the material of these grains; default: that of [scene]", above=0.0
    )
    material: str | None = parameter(None, doc="name of the [[material]] of these grains, where there are several")
    clump: int | Mapping[str, Any] | None = parameter(
        None, doc="a clump of spheres is packed in place of the shape: their number, or a table such as { mode = ... }"
    )
    faces: int | None = parameter(
        None, doc="largest number of triangles; a solid that has more is reduced as by vg.simplify", at_least=4
    )
    roughen: Mapping[str, Any] | None = parameter(None, doc="rough surface, a table such as { rms = 0.02 }")


@parameter_class
class ShapeOfFile:
    """Keys of a [[shape]] that is read from a file."""

    file: str = parameter(doc="mesh file, relative to the scene file")
    repair: bool = parameter(False, doc="a mesh that is not one closed solid is mended")
    surface: bool = parameter(False, doc="an open surface stays open")
    unit: str | None = parameter(None, doc="unit of the lengths in the file; default: that of the scene")


@parameter_class
class ShapeOfFamily:
    """Keys of a [[shape]] of a family, beside the parameters of that family."""

    family: str = parameter(doc="family of shapes; 'voxgran methods' lists them with their parameters")
    seed: int = parameter(0, doc="seed of a random family", at_least=0)
    count: int | None = parameter(None, doc="number of different shapes that the entry stands for", at_least=1)


@parameter_class
class Standing:
    """Keys of an [[obstacle]], beside those of a [[shape]] that say what shape it is."""

    position: tuple[float, ...] | None = parameter(None, doc="centroid of the shape, in two dimensions two numbers")
    orientation: tuple[float, float, float, float] = parameter(
        (1.0, 0.0, 0.0, 0.0), doc="quaternion (w, x, y, z) by which it is rotated; of any length"
    )
    scale: float = parameter(1.0, doc="factor on the lengths of the shape", above=0.0)
    packing: str | None = parameter(
        None, doc="file of a packing, all of whose grains are fixed, in place of a shape; relative to the scene file"
    )


@parameter_class
class ClumpOfShape:
    """Keys of the table `clump` of a [[shape]], beside the parameters of its method."""

    max_spheres: int | None = parameter(None, doc="number of spheres, with a target the largest", at_least=1)
    method: str = parameter("optimal", doc="clump method; 'voxgran methods' lists them with their parameters")
    target: Literal["iou", "volume", "inertia", "surface"] | None = parameter(
        None, doc="error that is to be reached with the fewest spheres"
    )
    value: float | None = parameter(None, doc="value of the target", above=0.0, at_most=1.0)
    seed: int = parameter(0, doc="seed of the method", at_least=0)


@parameter_class
class Packed:
    """Keys of [packing], beside the parameters of its method."""

    method: str = parameter(doc="packing method; 'voxgran methods' lists them with their parameters")
    count: int | None = parameter(None, doc="number of grains", at_least=0)
    solid_fraction: float | None = parameter(
        None, doc="solid fraction at which the packing ends; with a count, whichever comes first", above=0, at_most=1
    )
    start: str | None = parameter(None, doc="file of a packing whose grains are there from the beginning")


@parameter_class
class Shares:
    """Keys of [sizes], beside the parameters of its kind."""

    kind: str = parameter(doc="distribution of the equivalent diameters")
    share_by: Literal["number", "volume"] = parameter("number", doc="what the shares of the shapes are of")


@parameter_class
class Oriented:
    """Keys of [orientations], beside the parameters of its kind."""

    kind: str = parameter(doc="distribution of the orientations")


@parameter_class
class Layered:
    """Keys of [[layer]], beside its [[layer.shape]] entries, which are those of [[shape]]."""

    count: int | None = parameter(None, doc="number of grains of the layer", at_least=0)
    height: float | None = parameter(
        None, doc="thickness of the layer in place of count, with method 'gravity'", unit="length", above=0.0
    )
    sizes: Mapping[str, Any] | None = parameter(None, doc="distribution of the sizes, a table with the keys of [sizes]")
    orientations: Mapping[str, Any] | None = parameter(
        None, doc="distribution of the orientations, a table with the keys of [orientations]"
    )


@parameter_class
class Listed:
    """Keys of [grains]."""

    file: str = parameter(
        doc="table (CSV) of the grains, relative to the scene file, each row placed once: diameter or mass, shape (its "
        "family, the name of its file, or its index from 0 on), density, count"
    )


@parameter_class
class Settled:
    """Keys of [settle], beside the parameters of settling."""

    enabled: bool = parameter(True, doc="grains settle; false leaves them where the method ends")


@parameter_class
class NamedMaterial:
    """Keys of every [[material]], beside those of [material]."""

    name: str = parameter(doc="name, by which shapes, walls and pairs mean it")
    pair: Mapping[str, Any] | None = parameter(
        None, doc="properties of contacts with other materials, a table for each by its name: friction, "
        "rolling_friction, restitution, stiffness, shear_stiffness, cohesion; what is left out follows from both",
    )  # fmt: skip


@parameter_class
class OfContainer:
    """Keys of every [container]."""

    material: str | Mapping[str, Any] | None = parameter(
        None, doc="name of the [[material]] of all walls, or a table of them by the names of walls, such as "
        '{ z_low = "steel", others = "glass" }',
    )  # fmt: skip


@parameter_class
class Measured:
    """Keys of [measure]."""

    which: tuple[str, ...] | None = parameter(None, doc="measures, or 'all'; default: those that cost little")


def names_of(*classes: type) -> tuple[str, ...]:
    """Return the keys that classes describe."""
    return tuple(item.name for cls in classes for item in parameters_of(cls))
