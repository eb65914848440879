"""Shells: parts of a sphere without thickness, from shallow caps over half shells to spheres with a hole."""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import as_number
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape

#: number of corners around the axis, and largest angle between adjacent rings in degrees
SIDES, RING = 36, 10.0


@parameter_class
class Shell(Sized):
    """Parameters of a shell.

    Parameters
    ----------
    opening
        angle spanned at the center of the sphere, in degrees, in (0, 360); 180 is half of the sphere.
    diameter
        diameter of the disk of equal area; default: 1.

    Raises
    ------
    InputError
        If the shell has no area or no hole.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.shell(opening=90.0, diameter=1.0).diameter, 6)  # of the disk of the same area
    1.0
    """

    opening: float = parameter(180.0)

    def __post_init__(self) -> None:
        """Check that the shell is an open surface."""
        if not 0.0 < as_number(self.opening, "opening") < 360.0:
            raise InputError(
                f"opening is {self.opening:g} degrees: a shell spans more than 0 and less than 360; of a whole sphere "
                "use the family sphere"
            )


def make(parameters: Shell, generator: np.random.Generator) -> Shape:
    """Return the shell, with its corners on the sphere and its axis along z; nothing is random."""
    rings = max(2, int(np.ceil(parameters.opening / 2 / RING)))
    down = np.deg2rad(parameters.opening / 2) * np.arange(1, rings + 1) / rings
    around = 2 * np.pi * np.arange(SIDES) / SIDES
    flat = libm.sin(down)[:, None] * np.stack([libm.cos(around), libm.sin(around)])[:, None]
    level = np.broadcast_to(libm.cos(down)[:, None], flat.shape[1:])
    vertices = np.concatenate([[[0.0, 0.0, 1.0]], np.stack([*flat, level], axis=-1).reshape(-1, 3)])
    k, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    faces = [np.column_stack([np.zeros(SIDES, dtype=np.int64), 1 + k, 1 + after])]
    for ring in range(rings - 1):
        a, b = 1 + ring * SIDES + k, 1 + ring * SIDES + after
        faces += [np.column_stack([a, a + SIDES, b + SIDES]), np.column_stack([a, b + SIDES, b])]
    return sized(Surface(vertices, np.concatenate(faces)), parameters.diameter, name="shell")


registration = ShapeFamily(
    summary="open surface: a part of a sphere without thickness", parameters=Shell, make=make, is_open=True
)
