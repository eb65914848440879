"""What a sphere moves in, its contacts, and the work space of its moves."""

from typing import NamedTuple

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import KernelContainer
from voxgran.geometry.level_grid import LevelGrid

#: relative lengths and angles below this are rounding
SLIGHT = 1e-9
#: columns of a contact: normal toward the moving sphere; center of the other sphere; sum of the radii, negative where
#: the sphere moves inside a round wall, 0 for all other walls; and its kind
CENTER, REACH, KIND, WIDTH = 3, 6, 7, 8
#: kinds of contacts: with a plane wall, a sphere or a round wall, the wall of an upright cylinder, and with a triangle
# of a : mesh within its edges or elsewhere; these have its number in the column CENTER
PLANE, SPHERE, TUBE, FACET, EDGE = range(5)
#: rows of the work space, beside the contacts: direction of motion, pull, middle of a circle and its two axes
WAY, PULL, MIDDLE, FIRST, SECOND, ROWS = range(6)


class Field(NamedTuple):
    """What a sphere moves in, in coordinates from the lower corner of the container.

    spheres: (n, 4) centers and radii.  lengths: of the bounds.  flat: axes with plane walls on both sides, as 0 or 1.
    up: the axis against the pull.  central: whether the pull is to `target` instead, without walls.
    contacts: (3, WIDTH) and vectors: (ROWS, 3) work space.  edges: (m, 6) which edges and corners of the triangles of a
    mesh stand out into the container, as 0 or 1.  inlet: (5,) below which spheres fall: its center along the two axes
    across the pull, half its edges or the radius of a disk, and whether it is one.
    """

    spheres: Floats
    cells: LevelGrid
    lengths: Floats
    flat: Integers
    up: int
    central: bool
    target: Floats
    contacts: Floats
    vectors: Floats
    walls: KernelContainer
    edges: Integers
    inlet: Floats


class Motion(NamedTuple):
    """How a sphere of radius `r` moves from a place.

    kind: by the numbers of :mod:`voxgran.packing.deposition.meetings`.  place: (3,), the center.  kept: how many
    contacts it keeps.  radius: that of its circle.
    """

    kind: int
    place: Floats
    r: float
    kept: int
    radius: float


@bare_kernel
def copy_row(vectors: Floats, one: int, other: int, divisor: float) -> None:
    """Write a row over a number into another row."""
    for axis in range(3):
        vectors[other, axis] = vectors[one, axis] / divisor


@bare_kernel
def pull_from(field: Field, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the pull at a place, of any length."""
    if field.central:
        return field.target[0] - x, field.target[1] - y, field.target[2] - z
    return 0.0, -1.0 if field.up == 1 else 0.0, -1.0 if field.up == 2 else 0.0


@bare_kernel
def touch_sphere(field: Field, place: Floats, row: int, x: float, y: float, z: float, reach: float) -> None:
    """Write a contact with a sphere, or from inside with a round wall."""
    contact = field.contacts[row]
    contact[CENTER], contact[CENTER + 1], contact[CENTER + 2] = x, y, z
    contact[REACH], contact[KIND] = reach, SPHERE
    turn_normal(field, place, row)


@bare_kernel
def touch_wall(field: Field, row: int, axis: int, side: float) -> None:
    """Write a contact with a plane wall."""
    for column in range(WIDTH):
        field.contacts[row, column] = side if column == axis else 0.0


@bare_kernel
def turn_normal(field: Field, place: Floats, k: int) -> None:
    """Write the normal of a contact with a sphere or a round wall at the present place."""
    contact = field.contacts[k]
    if contact[REACH] != 0.0:
        for axis in range(3):
            contact[axis] = (place[axis] - contact[CENTER + axis]) / contact[REACH]
