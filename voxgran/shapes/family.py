"""Type and registry of shape families: one file each in `families`; shapes made of them, one or many."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass
from typing import Any

import numpy as np

from voxgran._base.arrays import as_count, as_positive, check_lengths
from voxgran._base.calls import explained
from voxgran._base.config import document, parameter, parameter_class, parameters_of, to_mapping
from voxgran._base.errors import CallError, InputError, shown
from voxgran._base.registry import Parameters, Registry
from voxgran._base.seeds import stream
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.generating.ranges import drawn
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Kind, Primitive

#: most shapes that are made at a time
MOST_SHAPES = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeFamily:
    """One registered family of shapes.

    Attributes
    ----------
    name, summary : str
        Name (the name of the file or entry point) and description in one line.
    parameters : type
        Parameter class, from which TOML keys, flags, help and provenance are derived.
    make : callable
        Function of parameters and a random generator that returns a Shape.
    source : str
        Reference with DOI, if there is one.
    dimension : int
        2 or 3.
    random : bool
        Whether shapes with the same parameters depend on the seed.
    is_open : bool
        Whether the shapes are open surfaces.
    libraries : tuple of str
        Libraries that making a shape loads beside NumPy and SciPy.
    """

    name: str = ""
    summary: str
    parameters: type
    make: Callable[[Any, np.random.Generator], Shape]
    source: str = ""
    dimension: int = 3
    random: bool = False
    is_open: bool = False
    libraries: tuple[str, ...] = ()


@parameter_class
class Sized:
    """Parameters of families whose shapes are made of any size.

    Parameters
    ----------
    diameter
        equivalent diameter; default: 1.
    """

    diameter: float | None = parameter(None, unit="length", above=0.0)


def families() -> Registry[ShapeFamily]:
    """Return the registry of shape families."""
    return Registry("shape family", "voxgran.shapes.families", ShapeFamily, group="voxgran.shape_families")


@explained(hint="shape_families()")
def shape_families() -> tuple[str, ...]:
    """Return the names of all shape families.

    Examples
    --------
    >>> import voxgran as vg
    >>> "sphere" in vg.shape_families()
    True
    """
    return families().names()


def default_families() -> tuple[str, ...]:
    """Return the names of the families that make shapes without any parameter given."""
    entries = ((name, families().get(name)) for name in shape_families())
    return tuple(name for name, one in entries if all(p.default is not MISSING for p in parameters_of(one.parameters)))


def family_function(name: str) -> Callable[..., Shape]:
    """Return the function that makes shapes of one family, with its parameters as keywords.

    Raises
    ------
    UnknownNameError
        If there is no such family.
    CallError
        By the returned function, if it is given a parameter by position.
    """
    entry = families().get(name)
    document(entry.parameters)

    hint = f"shapes.{name}({', '.join(f'{item.name}=...' for item in parameters_of(entry.parameters)[:1])})"

    def make(*arguments: Any, seed: int = 0, **parameters: Any) -> Shape:
        if arguments:
            raise CallError(
                f"{name} takes its parameters by name only and was given {shown(arguments[0])}; write {hint}"
            )
        return make_shape(name, seed=seed, **parameters)

    make.__name__ = make.__qualname__ = name
    rest = (entry.parameters.__doc__ or "").partition("\n\n")[2]
    make.__doc__ = f"Make a shape: {entry.summary}.\n\n{rest}"
    seeds = [parameter for parameter in inspect.signature(make).parameters.values() if parameter.name == "seed"]
    own = inspect.signature(entry.parameters).parameters
    keywords = [own[item.name] for item in parameters_of(entry.parameters)]
    made: Any = make
    made.__signature__ = inspect.Signature([*keywords, *(seeds if entry.random else ())], return_annotation=Shape)
    return make


@explained(hint='make_shape("polyhedron", seed=1)')
def make_shape(family: str | Parameters, *, seed: int = 0, **parameters: Any) -> Shape:
    """Make a shape of a family.

    The equivalent diameter is 1 unless a size is given.

    Parameters
    ----------
    family : str or parameter object
        One of :func:`shape_families`, or its parameters, such as ``vg.families.SolidUnion(solids=5)``.
    seed : int
        Seed of random families, and of values that are drawn; the same seed gives the same bits.
    **parameters
        Parameters of the family, with its name; `voxgran methods` lists them. In place of a number, a range such as
        ``points=(8, 20)`` may be given, from which it is drawn: a whole number with equal probabilities, another one
        uniformly.

    Returns
    -------
    Shape

    Raises
    ------
    UnknownNameError
        If the family or a parameter is not known.
    InputError
        If a parameter is out of range, or a length is not between 1e-60 and 1e60.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.make_shape("box", aspect=(1, 1, 2))
    Shape('box', primitive, diameter=1)
    """
    family, parameters = _with_drawn_values(family, parameters, seed)
    name, entry, values = families().chosen(family, parameters, where="", beside=("seed",))
    for key, value in to_mapping(values).items():
        _check_numbers(value, f"{name} {key}")
    return entry.make(values, stream(seed, f"shape {name}"))


@explained(hint='make_shapes("polyhedron", count=10)')
def make_shapes(family: str | Parameters, *, count: int, seed: int = 0, **parameters: Any) -> list[Shape]:
    """Make many shapes of a family, each with random numbers of its own.

    Parameters
    ----------
    family : str or parameter object
        As for :func:`make_shape`.
    count : int
        Number of shapes.
    seed : int
        Seed of all shapes; shape k is ``make_shape(family, seed=seeds_of_shapes(seed, count)[k], ...)``.
    **parameters
        Parameters of the family. Where a number is replaced by a range, each shape gets a value of its own.

    Returns
    -------
    list of Shape

    Raises
    ------
    UnknownNameError
        If the family or a parameter is not known.
    InputError
        If a parameter is out of range or `count` is negative; the message is about the first shape that cannot be made.

    Examples
    --------
    >>> import voxgran as vg
    >>> [len(shape.vertices) for shape in vg.make_shapes("convex_polyhedron", count=4, points=(8, 20))]
    [10, 17, 8, 12]
    """
    return [make_shape(family, seed=own, **parameters) for own in seeds_of_shapes(seed, count)]


@explained(hint="seeds_of_shapes(0, 10)")
def seeds_of_shapes(seed: int, count: int) -> list[int]:
    """Return the seeds of the shapes that :func:`make_shapes` makes with one seed; a larger count adds to them.

    Parameters
    ----------
    seed : int
        Seed of :func:`make_shapes`, at least 0.
    count : int
        Number of shapes, at most a million.

    Returns
    -------
    list of int
        Seed of each shape, as :func:`make_shape` takes it.

    Raises
    ------
    InputError
        If one of the two is no whole number of at least 0, or the count is above a million.

    Examples
    --------
    >>> import voxgran as vg
    >>> seeds = vg.seeds_of_shapes(7, 3)
    >>> seeds == vg.seeds_of_shapes(7, 4)[:3]
    True
    >>> rocks = vg.make_shapes("convex_polyhedron", count=3, seed=7)
    >>> rocks[2] == vg.make_shape("convex_polyhedron", seed=seeds[2])
    True
    """
    generator = stream(seed, "shapes")
    return [int(value) for value in generator.integers(2**53, size=as_count(count, "count", at_most=MOST_SHAPES))]


def _with_drawn_values(
    family: str | Parameters, parameters: Mapping[str, Any], seed: int
) -> tuple[str | Parameters, dict[str, Any]]:
    """Return the family and its parameters with a value drawn for each range."""
    name, given = family, dict(parameters)
    if not isinstance(family, str):
        name = next((key for key in families().names() if type(family) is families().get(key).parameters), "")
        values = to_mapping(family) if name and not parameters else {}
        given = {item.name: values[item.name] for item in parameters_of(type(family))} if values else {}
    if not given or not isinstance(name, str):
        return family, dict(parameters)
    values = drawn(families().get(name).parameters, given, stream(seed, f"shape {name} values"), where=name)
    changed = any(values[key] is not given[key] for key in given)
    return (name, values) if changed else (family, dict(parameters))


def _check_numbers(value: Any, name: str) -> None:
    """Check a real number, or all of a nested list, as lengths; counts have bounds of their own."""
    for part in value if isinstance(value, list | tuple) else ():
        _check_numbers(part, name)
    if isinstance(value, float):
        check_lengths(value, name)


def sized(geometry: Geometry, diameter: float | None, *, name: str, record: Mapping[str, Any] | None = None) -> Shape:
    """Return the shape of a geometry scaled to an equivalent diameter; None stands for 1. The record is kept as it is.

    Raises
    ------
    InputError
        If the diameter is not above 0.
    """
    if diameter is not None:
        as_positive(diameter, "diameter")
    raw = Shape.of(geometry, name=name)
    shape = Shape.of(geometry.scaled((diameter or 1.0) / raw.diameter), name=name, record=record)
    if isinstance(geometry, Mesh | Surface):
        return shape
    # a second step removes the rounding error of the first, if possible
    exact = (diameter or 1.0) / shape.diameter
    return shape if exact == 1.0 else shape.scaled(exact)


def refuse_both(diameter: float | None, dimensions: tuple[tuple[str, object], ...], **ratios: object) -> None:
    """Refuse a size that is given twice or in part, and ratios beside lengths.

    `dimensions` are the names of the lengths that define the size, with None for those that are not given.

    Raises
    ------
    InputError
        If lengths are given together with `diameter` or a ratio, or only some of the lengths are given.
    """
    given = [name for name, value in dimensions if value is not None]
    if given and len(given) < len(dimensions):
        missing = ", ".join(name for name, value in dimensions if value is None)
        raise InputError(f"{given[0]} is given without {missing}: both make the size; add it")
    if given and diameter is not None:
        raise InputError(f"diameter and {given[0]} are both given: each makes the size; leave one out")
    for name, ratio in ratios.items():
        if given and ratio is not None:
            raise InputError(f"{name} and {given[0]} are both given: each makes the ratio of lengths; leave one out")


def regular_solid(
    kind: Kind,
    parameters: Any,
    *,
    given: tuple[tuple[str, object], ...],
    lengths: tuple[float, ...] | None,
    ratios: tuple[float, ...],
) -> Shape:
    """Return a solid of given dimensions, or else of ratios scaled to the equivalent diameter of its parameters."""
    refuse_both(parameters.diameter, given, aspect=parameters.aspect)
    if lengths is not None:
        return Shape.of(Primitive(kind, lengths), name=kind)
    return sized(Primitive(kind, ratios), parameters.diameter, name=kind)


def round_radius(diameter: float | None, radius: float | None) -> float:
    """Return the radius of a sphere or a disk whose diameter or radius is given; with neither, the diameter is 1.

    Raises
    ------
    InputError
        If both are given, or one is not above 0.
    """
    refuse_both(diameter, (("radius", radius),))
    if radius is not None:
        return as_positive(radius, "radius")
    return as_positive(1.0 if diameter is None else diameter, "diameter") / 2
