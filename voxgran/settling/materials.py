"""Materials of grains and walls, with the properties of contacts between two of them."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_number, check_type
from voxgran._base.calls import explained_methods
from voxgran._base.config import from_mapping, parameter
from voxgran._base.errors import InputError, UnknownNameError, check_known, shown, unknown
from voxgran.contacts.assembly import Assembly
from voxgran.containers.model import Boundary, boundary_of
from voxgran.geometry.walls import Round
from voxgran.settling.material import Material

#: coefficient of friction where none is known
USUAL_FRICTION = 0.5
#: largest friction where one is found
ROUGH = 1.0
#: properties that a pair of materials may have of its own
OF_PAIRS = ("friction", "rolling_friction", "restitution", "stiffness", "shear_stiffness", "cohesion")
#: names of all walls that are not named, and of walls of revolution, to which a number is added where there are several
OTHERS, ROUND = "others", "round"
#: names of walls, beside those with a number
WALLS = (*(f"{axis}_{side}" for axis in "xyz" for side in ("low", "high")), ROUND, "mesh", "lid", OTHERS)


@explained_methods
@dataclass(frozen=True, slots=True)
class Materials(ExplainedAttributes):
    """Materials of several shapes and of the walls, and the properties of contacts between two of them.

    What a pair does not state follows from its two materials: the smaller friction and rolling friction; the geometric
    mean of the restitutions and of the surface energies; the harmonic mean of the stiffnesses, as of two springs in
    series; the mean of Poisson's ratios, and a Young's modulus with which the effective modulus is that of the two
    elastic solids.

    Parameters
    ----------
    materials
        materials by name, each a :class:`Material` or a mapping of its parameters; all have one contact law.
    pairs
        properties of contacts between two materials by their names, such as ``{("sand", "steel"): {"friction": 0.2}}``
        or ``{"sand": {"steel": {"friction": 0.2}}}``; two equal names stand for contacts within a material.
    shapes
        name of the material of all shapes, or one for each shape of the packing; one material needs none.
    walls
        name of the material of all walls, or one by the name of each wall: ``"x_low"``, ``"x_high"`` and so on for
        planes across the axes, ``"round"`` for cylinders, cones, spheres and oblique planes, of which several are
        ``"round_1"``, ``"round_2"`` and so on in the order of the container, ``"mesh"`` for a wall of triangles,
        ``"lid"``, and ``"others"`` for all that are not named; one material needs none.

    Raises
    ------
    InputError
        If there are no materials, their contact laws or bond strengths differ, one of several is not said of the
        shapes, a pair is given twice or is not two names, or a number is out of its range.
    UnknownNameError
        If a pair, a shape or a wall names an unknown material, or a property or a wall is unknown; the message gives
        the nearest name.

    Examples
    --------
    >>> import voxgran as vg
    >>> table = vg.Materials(
    ...     {"sand": vg.Material(friction=0.6), "steel": vg.Material(friction=0.3)},
    ...     pairs={("sand", "steel"): {"friction": 0.2}},
    ...     shapes="sand",
    ...     walls={"z_low": "steel", "others": "sand"},
    ... )
    >>> [table.between("sand", other).friction for other in ("sand", "steel")]
    [0.6, 0.2]
    """

    materials: Mapping[str, Any] = parameter()
    pairs: Mapping[Any, Any] | None = parameter(None)
    shapes: str | tuple[str, ...] | None = parameter(None)
    walls: str | Mapping[str, Any] | None = parameter(None)

    def __post_init__(self) -> None:
        """Check the names and the properties, and give all fields one form."""
        check_type(self.materials, Mapping, "materials", "a mapping such as {'sand': Material(friction=0.6)}")
        if not self.materials:
            raise InputError("materials is {}: it must hold at least one material; give one by its name")
        made = {_name(name): _material(name, value) for name, value in self.materials.items()}
        object.__setattr__(self, "materials", made)
        for what in ("law", "bond_strength"):
            found = [getattr(value, what) for value in made.values()]
            if found != [found[0]] * len(found):
                raise InputError(
                    f"material {what} is {' and '.join(map(shown, found))}: an engine has one for all contacts; give "
                    "all materials the same"
                )
        object.__setattr__(self, "pairs", self._given_pairs())
        if self.shapes is None and len(made) > 1:
            raise InputError(
                f"shapes is None, and there are {len(made)} materials: each shape needs one; name it for all of them, "
                f"or in a list with one name for each shape, such as shapes=[{self.names[0]!r}]"
            )
        if not isinstance(self.shapes, str | None):
            object.__setattr__(self, "shapes", tuple(_names_in(self.shapes, "shapes")))
        of_walls = self.walls.values() if isinstance(self.walls, Mapping) else (self.walls,)
        of_shapes = self.shapes if isinstance(self.shapes, tuple) else (self.shapes,)
        for what, held in (("shapes", of_shapes), ("walls", of_walls)):
            for name in held:
                if name is not None:
                    self._known(name, f"material of {what}")
        for name in self.walls if isinstance(self.walls, Mapping) else ():
            if name not in WALLS and not re.fullmatch(rf"{ROUND}_[1-9][0-9]*", str(name)):
                raise UnknownNameError(unknown("wall of the materials", name, WALLS))
        for first, second in combinations_with_replacement(self.names, 2):
            self.between(first, second)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the materials."""
        return tuple(self.materials)

    def between(self, first: str, second: str) -> Material:
        """Return the material of contacts between two materials, by their names.

        Raises
        ------
        UnknownNameError
            If a material or a property of the pair is unknown.
        InputError
            If a property of the pair is out of its range.

        Examples
        --------
        >>> import voxgran as vg
        >>> table = vg.Materials({"glass": {"restitution": 0.9}, "rubber": {"restitution": 0.4}}, shapes="glass")
        >>> round(table.between("glass", "rubber").restitution, 3)
        0.6
        """
        a, b = (self.materials[self._known(name, "material")] for name in (first, second))
        low, high = sorted((first, second))
        given = dict(self.pairs or {}).get(low, {}).get(high, {})
        mixed = a if first == second else _mixed(a, b)
        return replace(mixed, **given) if given else mixed

    def of_shapes(self, count: int) -> tuple[str, ...]:
        """Return the name of the material of each of so many shapes.

        Raises
        ------
        InputError
            If there are more or fewer names than shapes.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Materials({"glass": vg.Material()}).of_shapes(2)
        ('glass', 'glass')
        """
        if self.shapes is None or isinstance(self.shapes, str):
            return (self.shapes or self.names[0],) * count
        if len(self.shapes) != count:
            raise InputError(
                f"shapes of the materials has {len(self.shapes)} names: the packing has {count} shapes; give one for "
                "each, or one name for all"
            )
        return self.shapes

    def of_wall(self, name: str) -> str:
        """Return the name of the material of a wall.

        Raises
        ------
        InputError
            If none is said of it.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Materials({"glass": vg.Material()}).of_wall("z_low")
        'glass'
        """
        if isinstance(self.walls, str):
            return self.walls
        named = self.walls or {}
        found = named.get(name) or (named.get(ROUND) if name.startswith(ROUND) else None) or named.get(OTHERS)
        if found is None and len(self.names) > 1:
            raise InputError(
                f"walls of the materials is {shown(self.walls)}: it says nothing of the wall {name!r}; name the "
                f"material of all walls, such as walls={self.names[-1]!r}, in a scene as material of [container], or "
                f"give {name!r} or 'others' in it"
            )
        return str(found or self.names[0])

    def _known(self, name: Any, what: str) -> str:
        """Return the name of a material that is there."""
        if not isinstance(name, str) or name not in self.materials:
            raise UnknownNameError(unknown(what, name, self.names))
        return name

    def _given_pairs(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Return the properties of pairs by both names in alphabetical order."""
        made: dict[str, dict[str, dict[str, Any]]] = {}
        for first, second, values in _pair_entries(self.pairs):
            for name in (first, second):
                self._known(name, "material of a pair")
            low, high = sorted((first, second))
            where = f"pair {low!r} and {high!r}"
            check_type(values, Mapping, where, "a mapping of properties, such as {'friction': 0.2}")
            for key in values:
                check_known(f"property of {where}", key, OF_PAIRS)
            if high in made.setdefault(low, {}):
                raise InputError(f"{where} is given twice: contacts have one friction either way; leave one out")
            # a law that takes all of them checks types and ranges
            checked = from_mapping(Material, {**values, "law": "hertz", "young_modulus": 1.0}, where)
            made[low][high] = {key: getattr(checked, key) for key in values}
        return made


class FrictionTable:
    """Coefficients of friction of contacts by the materials of grains and walls.

    Parameters
    ----------
    materials : Materials
        Materials of the shapes and the walls.
    shape_id : (n,) ndarray of int
        Shape of each grain.
    shapes : int
        Number of shapes.
    walls : sequence of str
        Names of the walls.

    Attributes
    ----------
    least, largest : float
        Least and largest coefficient between materials of grains, and of them and walls.
    walls_differ : bool
        Whether not all walls have one material.
    """

    def __init__(self, materials: Materials, shape_id: Integers, shapes: int, walls: Sequence[str]) -> None:
        names = materials.names
        of_shapes = np.array([names.index(name) for name in materials.of_shapes(shapes)], dtype=np.int64)
        self._pairs: Floats = np.array([[materials.between(a, b).friction for b in names] for a in names])
        self._grains: Integers = of_shapes[shape_id]
        self._walls: Integers = np.array([names.index(materials.of_wall(name)) for name in walls], dtype=np.int64)
        used = np.unique(self._grains)
        found = self._pairs[np.ix_(used, np.union1d(used, self._walls))]
        self.least, self.largest = float(found.min(initial=np.inf)), float(found.max(initial=0.0))
        self.walls_differ = len(np.unique(self._walls)) > 1

    def of_contacts(self, i: Integers, j: Integers, wall: Integers) -> Floats:
        """Return the coefficients (m,) of contacts of grains i with grains j, or with walls where j is negative."""
        partner = self._grains[np.maximum(j, 0)]
        if len(self._walls):
            partner = np.where(j >= 0, partner, self._walls[wall])
        return np.asarray(self._pairs[self._grains[i], partner])

    @property
    def mean(self) -> float:
        """Coefficient of grains that meet at random."""
        share = np.bincount(self._grains, minlength=len(self._pairs)) / max(len(self._grains), 1)
        return float(linear.matmul(linear.matmul(share, self._pairs), share))


def friction_of(friction: "float | Materials | None", assembly: Assembly) -> "float | FrictionTable":
    """Return the friction of the contacts of grains, with each other, with the walls of their container and the lid.

    Raises
    ------
    InputError
        If a shape or a wall has no material.
    """
    friction = USUAL_FRICTION if friction is None else friction
    if not isinstance(friction, Materials):
        return friction
    walls = wall_names(boundary_of(assembly.container)) + (("lid",) if assembly.lid is not None else ())
    return FrictionTable(friction, assembly.shape_id, len(assembly.shapes), walls)


def wall_names(boundary: Boundary) -> tuple[str, ...]:
    """Return the names of the walls of a container: planes, walls of revolution, and a surface of triangles."""
    names = [plane.name for plane in boundary.planes]
    for wall in boundary.round:
        across = _name_of_plane(wall) if wall.kind == "plane" else ""
        names.append("" if across in names else across)
    rounds = [ROUND] if names.count("") == 1 else [f"{ROUND}_{k + 1}" for k in range(names.count(""))]
    numbered = iter(rounds)
    return (*(name or next(numbered) for name in names), *("mesh",) * (boundary.solid is not None))


def _name_of_plane(wall: Round) -> str:
    """Return the name of a plane across an axis, such as ``"z_low"``; empty for an oblique one."""
    axis = int(np.abs(wall.axis).argmax())
    if np.count_nonzero(wall.axis) > 1:
        return ""
    return f"{'xyz'[axis]}_{'high' if wall.axis[axis] > 0 else 'low'}"


def friction_range(friction: "float | FrictionTable") -> tuple[float, float]:
    """Return the least and the largest coefficient of friction of contacts."""
    return (friction.least, friction.largest) if isinstance(friction, FrictionTable) else (friction, friction)


def largest_friction(friction: "float | Materials") -> float:
    """Return the largest coefficient of friction of a table of materials, or the one coefficient."""
    if not isinstance(friction, Materials):
        return friction
    pairs = combinations_with_replacement(friction.names, 2)
    return max(friction.between(first, second).friction for first, second in pairs)


def as_friction(friction: Any, *, at_most: float = math.inf, sought: float | None = None) -> "float | Materials":
    """Return a checked coefficient of friction, or a table of materials of which each pair has one.

    sought: solid fraction for which a friction is to be found.

    Raises
    ------
    InputError
        If it is something else, out of its range, or a table although a solid fraction is sought.
    """
    if not isinstance(friction, Materials):
        return as_number(friction, "friction", at_least=0.0, at_most=at_most)
    for first, second in combinations_with_replacement(friction.names, 2):
        as_number(friction.between(first, second).friction, f"friction of {first!r} and {second!r}", at_most=at_most)
    if sought is not None:
        raise InputError(
            f"solid_fraction is {sought:g} and friction is by materials: one friction is found that gives a solid "
            "fraction; leave one of them out"
        )
    return friction


def mean_friction(friction: "float | Materials | None", shape_id: Integers, shapes: int) -> float:
    """Return the coefficient of friction of contacts between grains that meet at random; the usual one for None."""
    if not isinstance(friction, Materials):
        return USUAL_FRICTION if friction is None else friction
    return FrictionTable(friction, shape_id, shapes, ()).mean


def friction_text(friction: "float | Materials") -> str:
    """Return the friction in words: the number, or that it is by materials."""
    return f"{friction:g}" if not isinstance(friction, Materials) else f"by materials {', '.join(friction.names)}"


def _material(name: str, value: Any) -> Material:
    """Return a material, made of a mapping of its parameters where it is none yet."""
    if isinstance(value, Mapping):
        return from_mapping(Material, value, f"material {name!r}")
    check_type(value, Material, f"material {name!r}", "a Material, or a mapping of its parameters")
    return value


def _name(name: Any) -> str:
    """Return the name of a material, which is text that is not empty."""
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"name of a material is {shown(name)}: it must be text; give a name such as 'sand'")
    return name


def _names_in(value: Any, what: str) -> Sequence[Any]:
    """Return a sequence of names."""
    if not isinstance(value, Sequence):
        raise InputError(f"{what} is {shown(value)}: it must be a name, or a list of one for each shape; correct it")
    return value


def _pair_entries(pairs: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Yield both names and the properties of each pair."""
    check_type(pairs, (Mapping, type(None)), "pairs", "a mapping such as {('sand', 'steel'): {'friction': 0.2}}")
    for key, values in (pairs or {}).items():
        if isinstance(key, tuple):
            if len(key) != 2:
                raise InputError(f"pair {shown(key)} has {len(key)} names: contacts are between two; give two")
            yield *key, values
        else:
            check_type(values, Mapping, f"pairs of {shown(key)}", "a mapping of the other names")
            yield from ((key, other, properties) for other, properties in values.items())


def _mixed(a: Material, b: Material) -> Material:
    """Return the material of contacts between two others of which the pair states nothing."""
    values: dict[str, Any] = {
        "friction": min(a.friction, b.friction),
        "rolling_friction": min(a.rolling_friction, b.rolling_friction),
        "restitution": math.sqrt(a.restitution * b.restitution),
        "cohesion": math.sqrt(a.cohesion * b.cohesion),
        "poisson_ratio": (a.poisson_ratio + b.poisson_ratio) / 2,
        **{name: _in_series(getattr(a, name), getattr(b, name)) for name in ("stiffness", "shear_stiffness")},
    }
    plane = [_over(one.young_modulus, 1 - one.poisson_ratio**2) for one in (a, b)]
    modulus = _in_series(*plane)
    values["young_modulus"] = None if modulus is None else modulus * (1 - values["poisson_ratio"] ** 2)
    return replace(a, density=None, **values)


def _over(value: float | None, divisor: float) -> float | None:
    """Return a value over a divisor; None where there is none."""
    return None if value is None else value / divisor


def _in_series(first: float | None, second: float | None) -> float | None:
    """Return the harmonic mean of two stiffnesses; the one that is given, where the other is not."""
    if first is None or second is None:
        return second if first is None else first
    return 2 / (1 / first + 1 / second)
