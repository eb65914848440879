"""Parameters of compression: the stress, the axes that move, friction, and what counts as balanced."""

from typing import ClassVar

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError, shown
from voxgran.containers.model import Container
from voxgran.containers.stretch import stretched_together
from voxgran.settling.materials import Materials, as_friction
from voxgran.settling.parameters import MOST_FRICTION


@parameter_class
class Compression:
    """How grains are compressed.

    Parameters
    ----------
    stress
        mean stress along all axes, or one along each axis, compression above 0, in any unit: only the ratios decide how
        the grains lie; along axes that do not move it is not prescribed.
    axes
        axes along which the container is compressed, such as "z" for an oedometric path.
    friction
        Coulomb coefficient of friction between grains and at walls; less friction gives a denser packing; or a table of
        materials, with one friction for each pair.
    solid_fraction
        solid fraction of the compressed packing, met to 0.002: the friction (up to 1) is found that gives it; that of
        the bulk or, in containers without periodic sides of few grains, of the container; if omitted, as the friction
        gives it.
    height
        height of the container at the end, along its last axis, which alone is compressed: the friction is found that
        gives it, as with a solid fraction, which is then that of the container.
    rate
        viscous number of the compression: strain rate times the drag of a grain of the median diameter, over stress
        times diameter (in 2D over the stress); grains that are compressed slower become a little denser; if omitted,
        3e-3, and 3e-5 with a friction below 0.05.
    rest
        share of the grains that bear forces which must be in balance so that the packing counts as compressed.

    Raises
    ------
    InputError
        If a number is out of its range, or there is a solid fraction beside a height.
    """

    #: grains are not shaken
    shaking: ClassVar[None] = None

    stress: float | tuple[float, ...] = parameter(1.0, above=0.0, at_most=1e60)
    axes: str = parameter("xyz")
    friction: float | Materials = parameter(0.5, at_least=0.0, at_most=MOST_FRICTION)
    solid_fraction: float | None = parameter(None, above=0.0, at_most=1.0)
    height: float | None = parameter(None, above=0.0)
    rate: float | None = parameter(None, at_least=1e-6, at_most=0.1)
    rest: float = parameter(0.98, above=0.0, at_most=1.0)

    def __post_init__(self) -> None:
        """Check the ranges and the names of the axes."""
        check_bounds(self)
        as_friction(self.friction, at_most=MOST_FRICTION, sought=self.solid_fraction)
        if not self.axes or len(set(self.axes)) < len(self.axes) or not set(self.axes) <= set("xyz"):
            raise InputError(
                f"axes is {shown(self.axes)}: it must name axes out of x, y, z, each once, such as 'z'; correct it"
            )

        if self.height is not None and self.solid_fraction is not None:
            raise InputError(
                f"height is {self.height:g} and solid_fraction is {self.solid_fraction:g}: either says how dense the "
                "grains become; leave one of them out"
            )

    def stress_along(self, dimension: int) -> Floats:
        """Return the stresses (xx, yy, zz, yz, xz, xy), those of shear 0.

        Raises
        ------
        InputError
            If there are more or fewer numbers than axes.
        """
        stress, given = np.zeros(6), np.atleast_1d(np.asarray(self.stress, dtype=np.float64))
        if len(given) not in (1, dimension):
            raise InputError(
                f"stress is {shown(self.stress)}: it must be one number, or {dimension}, one along each axis; correct "
                "it"
            )
        stress[:dimension] = given
        return stress

    def modes_of(self, container: Container) -> Floats:
        """Return the projection (6, 6) onto the strains that the container may have.

        Raises
        ------
        InputError
            If none of its walls moves along the axes, stresses differ along axes that stretch together, or there is a
        height and other axes move.
        """
        stress, modes = self.stress_along(container.dimension), np.zeros((6, 6))
        last = "xyz"[container.dimension - 1]
        if self.height is not None and self.axes != last:
            raise InputError(f"height is {self.height:g} and axes is {self.axes!r}: it needs axes={last!r}; change it")
        free = {"xyz".index(axis) for axis in self.axes}
        groups = stretched_together(container)
        for group in groups:
            if not free.issuperset(group):
                continue
            if np.ptp(stress[list(group)]) > 0.0:
                names = " and ".join("xyz"[axis] for axis in group)
                raise InputError(
                    f"stress is {shown(self.stress)}: a {container.kind} has one stress along {names}; give equal "
                    "numbers"
                )
            mode = np.zeros(6)
            mode[list(group)] = 1.0
            modes += np.outer(mode, mode) / len(group)
        if not modes.any():
            names = ", ".join(repr("".join("xyz"[axis] for axis in group)) for group in groups)
            raise InputError(
                f"axes is {self.axes!r}: a {container.kind} is compressed along {names} only; name one of them"
            )
        return modes
