"""Keys of a scene that are no parameters of a calculation: the one table of their names, types and meanings.

The checks take the names from here, the reference of the scene file names, types and meanings.
Mistakes of independent sections are raised together, so that one reading finds them all.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Literal

from voxgran._base.config import parameter, parameter_class, parameters_of
from voxgran._base.errors import InputError, UnknownNameError, VoxgranError, unknown
from voxgran.scene.sections import General, Output
from voxgran.settling.material import Material
from voxgran.settling.parameters import MOST_POROUS, Compression, Settling


@parameter_class
class AnyShape:
    """Keys of every [[shape]].

    Parameters
    ----------
    share
        share of the grains that have this shape.
    density
        density of the material of these grains; default: that of [scene].
    material
        name of the [[material]] of these grains, where there are several.
    clump
        a clump of spheres is packed in place of the shape: their number, or a table such as { mode = ... }.
    faces
        largest number of triangles; a solid that has more is reduced as by vg.simplify.
    roughen
        rough surface, a table such as { rms = 0.02 }.
    """

    share: float = parameter(1.0, at_least=0.0)
    density: float | None = parameter(None, above=0.0)
    material: str | None = parameter(None)
    clump: int | Mapping[str, Any] | None = parameter(None)
    faces: int | None = parameter(None, at_least=4)
    roughen: Mapping[str, Any] | None = parameter(None)


@parameter_class
class ShapeOfFile:
    """Keys of a [[shape]] that is read from a file.

    Parameters
    ----------
    file
        mesh file, relative to the scene file.
    repair
        a mesh that is not one closed solid is mended.
    surface
        an open surface stays open.
    unit
        unit of the lengths in the file; default: that of the scene.
    """

    file: str = parameter()
    repair: bool = parameter(False)
    surface: bool = parameter(False)
    unit: str | None = parameter(None)


@parameter_class
class ShapeOfFamily:
    """Keys of a [[shape]] of a family, beside the parameters of that family.

    Parameters
    ----------
    family
        family of shapes; 'voxgran methods' lists them with their parameters. With the key model it may be left out: it
        is 'learned', and the count 50.
    seed
        seed of a random family.
    count
        number of different shapes that the entry stands for.
    """

    family: str = parameter()
    seed: int = parameter(0, at_least=0)
    count: int | None = parameter(None, at_least=1)


@parameter_class
class Standing:
    """Keys of an [[obstacle]], beside those of a [[shape]] that say what shape it is.

    Parameters
    ----------
    position
        centroid of the shape, in two dimensions two numbers.
    orientation
        quaternion (w, x, y, z) by which it is rotated; of any length.
    scale
        factor on the lengths of the shape.
    packing
        file of a packing, all of whose grains are fixed, in place of a shape; relative to the scene file.
    """

    position: tuple[float, ...] | None = parameter(None)
    orientation: tuple[float, float, float, float] = parameter((1.0, 0.0, 0.0, 0.0))
    scale: float = parameter(1.0, above=0.0)
    packing: str | None = parameter(None)


@parameter_class
class ClumpOfShape:
    """Keys of the table `clump` of a [[shape]], beside the parameters of its method.

    Parameters
    ----------
    max_spheres
        number of spheres, with a target the largest.
    method
        clump method; 'voxgran methods' lists them with their parameters.
    target
        error that is to be reached with the fewest spheres.
    value
        value of the target.
    seed
        seed of the method.
    """

    max_spheres: int | None = parameter(None, at_least=1)
    method: str = parameter("optimal")
    target: Literal["iou", "volume", "inertia", "surface"] | None = parameter(None)
    value: float | None = parameter(None, above=0.0, at_most=1.0)
    seed: int = parameter(0, at_least=0)


#: keys of [packing] of which one says how dense the grains become
DENSITIES: tuple[str, ...] = ("solid_fraction", "porosity", "void_ratio")


@parameter_class
class Packed:
    """Keys of [packing], beside the parameters of its method.

    Parameters
    ----------
    method
        packing method; 'voxgran methods' lists them with their parameters.
    count
        number of grains.
    solid_fraction
        solid fraction at which the packing ends; with a count, whichever comes first.
    porosity
        1 - solid fraction, in place of it.
    void_ratio
        volume of the voids over that of the grains, in place of the solid fraction.
    start
        file of a packing whose grains are there from the beginning.
    """

    method: str = parameter()
    count: int | None = parameter(None, at_least=0)
    solid_fraction: float | None = parameter(None, above=0, at_most=1)
    porosity: float | None = parameter(None, at_least=0, at_most=MOST_POROUS)
    void_ratio: float | None = parameter(None, at_least=0)
    start: str | None = parameter(None)


@parameter_class
class Shares:
    """Keys of [sizes], beside the parameters of its kind.

    Parameters
    ----------
    kind
        distribution of the equivalent diameters.
    share_by
        what the shares of the shapes are of.
    """

    kind: str = parameter()
    share_by: Literal["number", "volume"] = parameter("number")


@parameter_class
class Oriented:
    """Keys of [orientations], beside the parameters of its kind.

    Parameters
    ----------
    kind
        distribution of the orientations.
    """

    kind: str = parameter()


@parameter_class
class Layered:
    """Keys of [[layer]], beside its [[layer.shape]] entries, which are those of [[shape]].

    Parameters
    ----------
    count
        number of grains of the layer.
    height
        thickness of the layer in place of count, with method 'gravity'.
    sizes
        distribution of the sizes, a table with the keys of [sizes].
    orientations
        distribution of the orientations, a table with the keys of [orientations].
    """

    count: int | None = parameter(None, at_least=0)
    height: float | None = parameter(None, unit="length", above=0.0)
    sizes: Mapping[str, Any] | None = parameter(None)
    orientations: Mapping[str, Any] | None = parameter(None)


@parameter_class
class Listed:
    """Keys of [grains].

    Parameters
    ----------
    file
        table (CSV) of the grains, relative to the scene file, each row placed once: diameter or mass, shape (its
        family, the name of its file, or its index from 0 on), density, count.
    """

    file: str = parameter()


@parameter_class
class Twinned:
    """Keys of [twin], beside the parameters of the method that its protocol is.

    Parameters
    ----------
    sample
        file of the packing that the twin equals, relative to the scene file.
    count
        number of grains; default: as many as fill [container], without it as many as the sample has whole.
    solid_fraction
        solid fraction of the twin; default: that of the sample.
    protocol
        how the grains come together; default: gravity where the sample has it, otherwise compress.
    model
        file of a learned distribution of shapes; default: it is learned from the sample.
    faces
        most triangles of a grain.
    forms
        most different shapes.
    voxel_size
        edge of the voxels on which both are compared; default: as vg.twin chooses it.
    """

    sample: str = parameter()
    count: int | None = parameter(None, at_least=1)
    solid_fraction: float | None = parameter(None, above=0, at_most=1)
    protocol: Literal["gravity", "compress", "expand"] | None = parameter(None)
    model: str | None = parameter(None)
    faces: int = parameter(200, at_least=4)
    forms: int = parameter(100, at_least=1)
    voxel_size: float | None = parameter(None, unit="length", above=0.0)


@parameter_class
class Settled:
    """Keys of [settle], beside the parameters of settling.

    Parameters
    ----------
    enabled
        grains settle; false leaves them where the method ends.
    """

    enabled: bool = parameter(True)


@parameter_class
class NamedMaterial:
    """Keys of every [[material]], beside those of [material].

    Parameters
    ----------
    name
        name, by which shapes, walls and pairs mean it.
    pair
        properties of contacts with other materials, a table for each by its name: friction, rolling_friction,
        restitution, stiffness, shear_stiffness, cohesion; what is left out follows from both.
    """

    name: str = parameter()
    pair: Mapping[str, Any] | None = parameter(None)


@parameter_class
class OfContainer:
    """Keys of every [container].

    Parameters
    ----------
    material
        name of the [[material]] of all walls, or a table of them by the names of walls, such as { z_low = "steel",
        others = "glass" }.
    """

    material: str | Mapping[str, Any] | None = parameter(None)


@parameter_class
class Measured:
    """Keys of [measure].

    Parameters
    ----------
    which
        measures, or 'all'; default: those that cost little.
    """

    which: tuple[str, ...] | None = parameter(None)


def names_of(*classes: type) -> tuple[str, ...]:
    """Return the keys that classes describe."""
    return tuple(item.name for cls in classes for item in parameters_of(cls))


#: keys of the sections, to name the right one where a key is in another; [packing] and [scene] come first
_PLACES = {
    "[scene]": names_of(General),
    "[packing]": names_of(Packed),
    "[output]": names_of(Output),
    "[settle]": names_of(Settled, Settling),
    "[compress]": names_of(Compression),
    "[material]": names_of(Material),
    "[[material]]": names_of(NamedMaterial),
    "[measure]": names_of(Measured),
    "[sizes]": names_of(Shares),
    "[orientations]": names_of(Oriented),
    "[grains]": names_of(Listed),
    "[twin]": names_of(Twinned),
    "[[shape]]": names_of(ShapeOfFamily, ShapeOfFile, AnyShape),
}


class Mistakes:
    """Errors of the parts of one input."""

    def __init__(self) -> None:
        self.found: list[VoxgranError] = []

    @contextmanager
    def part(self, section: str = "") -> Iterator[None]:
        """Keep an error of bad input that the block raises (context manager), which names a section if one is given."""
        try:
            yield
        except VoxgranError as error:
            if error.exit_code != InputError.exit_code:
                raise
            told = str(error)
            self.found.append(error if told.startswith("[") or not section else type(error)(f"{section} {told}"))

    def refuse(self) -> None:
        """Raise what was found.

        Raises
        ------
        VoxgranError
            The only error that was found.
        InputError
            If there are several, with the sentences of all.
        """
        if len(self.found) == 1:
            raise self.found[0]
        if self.found:
            listed = "; ".join(f"({number}) {error}" for number, error in enumerate(self.found, 1))
            raise InputError(f"the scene has {len(self.found)} mistakes: {listed}")


def refuse_unknown(mapping: Mapping[str, Any], place: str, cls: type, *, beside: tuple[str, ...] = ()) -> None:
    """Refuse keys of a section that are neither parameters of its class nor among those beside.

    Raises
    ------
    UnknownNameError
        If there is one; the message names the section whose key it is, or else the nearest key.
    """
    known = (*(item.name for item in parameters_of(cls)), *beside)
    for key in mapping:
        if key not in known:
            right = next((other for other, names in _PLACES.items() if other != place and key in names), None)
            moved = f"{place} key {key!r} is unknown: it is a key of {right}; write it there" if right else ""
            raise UnknownNameError(moved or unknown(f"{place} key", key, known))
