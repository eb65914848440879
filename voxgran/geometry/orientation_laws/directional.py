"""Distributions of directions about an axis: uniform, aligned, Fisher, Watson, Bingham."""

from typing import Any, ClassVar

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.geometry.orientation_laws.law import Axis, OrientationLaw, as_axis, axis_in, frame_of, in_space

#: largest concentration
MOST = 1e12
#: cosine up to which two axes are at right angles
SQUARE = 1e-9
#: halvings of the interval of an integral towards its end, and nodes in each part
HALVINGS, NODES = 50, 24


@parameter_class
class Random(OrientationLaw):
    """All orientations are equally likely."""

    kind: ClassVar[str] = "random"

    def directions(self, count: int, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Draw directions from all."""
        return in_space(generator.normal(size=(count, dimension)))

    def moment(self, *, dimension: int) -> Floats:
        """Return the isotropic tensor."""
        return np.eye(dimension) / dimension


@parameter_class
class Aligned(OrientationLaw):
    """All bodies point along one axis.

    Parameters
    ----------
    axis
        axis in the container, a name or a vector of any length.

    Raises
    ------
    InputError
        If an axis is neither a name nor a vector, or its length is 0.
    """

    kind: ClassVar[str] = "aligned"

    axis: Axis | tuple[float, ...] = parameter()

    def __post_init__(self) -> None:
        """Check the ranges and the axes."""
        OrientationLaw.__post_init__(self)
        as_axis(self.axis, "axis")

    def directions(self, count: int, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Return the axis, `count` times."""
        return np.tile(axis_in(self.axis, "axis", dimension), (count, 1))

    def moment(self, *, dimension: int) -> Floats:
        """Return the tensor of the axis."""
        return _about(axis_in(self.axis, "axis", dimension), 1.0, dimension)


@parameter_class
class Fisher(Aligned):
    """Density proportional to exp(kappa n . m) for directions n about m (von Mises and Fisher).

    Parameters
    ----------
    kappa
        concentration: 0 for directions at random, the larger, the closer they are to the axis.

    Raises
    ------
    InputError
        If kappa is not from 0 to 1e12, an axis is neither a name nor a vector, or its length is 0.
    """

    kind: ClassVar[str] = "fisher"

    kappa: float = parameter(at_least=0.0, at_most=MOST)

    def directions(self, count: int, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Draw by the inverse of the distribution function of the angle; in the plane as NumPy does."""
        frame = frame_of(axis_in(self.axis, "axis", dimension), dimension)
        if dimension == 2:
            angle = generator.vonmises(0.0, self.kappa, size=count)
            return in_space(linear.matmul(np.column_stack([libm.cos(angle), libm.sin(angle)]), frame.T))
        share, azimuth = generator.random(count), 2.0 * np.pi * generator.random(count)
        # 1 - cos of the angle, exact also for small angles
        below = 2.0 * share
        if self.kappa > 0.0:
            below = np.minimum(-libm.log1p(share * libm.expm1(-2.0 * self.kappa)) / self.kappa, 2.0)
        across = np.sqrt(below * (2.0 - below))
        return in_space(
            linear.matmul(
                np.column_stack([1.0 - below, across * libm.cos(azimuth), across * libm.sin(azimuth)]), frame.T
            )
        )

    def moment(self, *, dimension: int) -> Floats:
        """Return the tensor by the ratio of two Bessel functions, in space the function of Langevin."""
        axis, kappa = axis_in(self.axis, "axis", dimension), self.kappa
        if kappa == 0.0:
            return np.eye(dimension) / dimension
        bessel = load("scipy.special").ive
        mean = float(bessel(0.5 * dimension, kappa) / bessel(0.5 * dimension - 1.0, kappa))
        return _about(axis, 1.0 - (dimension - 1) * mean / kappa, dimension)


@parameter_class
class Watson(Aligned):
    """Density proportional to exp(kappa (n . m)^2) for directions n about m, of which both senses are alike.

    Parameters
    ----------
    kappa
        concentration: above 0 about the axis, 0 for directions at random, below 0 about the plane across it.

    Raises
    ------
    InputError
        If kappa is not within 1e12, an axis is neither a name nor a vector, or its length is 0.
    """

    kind: ClassVar[str] = "watson"

    kappa: float = parameter(at_least=-MOST, at_most=MOST)

    def directions(self, count: int, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Draw as from a Bingham distribution."""
        kappas, frame = self._principal(dimension)
        return in_space(linear.matmul(bingham_directions(kappas, count, generator), frame.T))

    def moment(self, *, dimension: int) -> Floats:
        """Return the tensor by quadrature."""
        kappas, frame = self._principal(dimension)
        return np.asarray(linear.matmul(frame * bingham_moments(kappas), frame.T))

    def _principal(self, dimension: int) -> tuple[Floats, Floats]:
        """Return concentrations (d,) along the columns of a frame (d, d)."""
        kappas = np.zeros(dimension)
        kappas[0] = self.kappa
        return kappas, frame_of(axis_in(self.axis, "axis", dimension), dimension)


@parameter_class
class Bingham(Watson):
    """Density proportional to exp(kappa (n . m)^2 + second_kappa (n . s)^2), with m and s at right angles.

    Parameters
    ----------
    second_axis
        another axis in the container, at right angles to the first.
    second_kappa
        concentration along it.

    Raises
    ------
    InputError
        If a concentration is not within 1e12, an axis is neither a name nor a vector, its length is 0, or the axes are
        not at right angles.
    """

    kind: ClassVar[str] = "bingham"

    second_axis: Axis | tuple[float, ...] = parameter()
    second_kappa: float = parameter(at_least=-MOST, at_most=MOST)

    def __post_init__(self) -> None:
        """Check the ranges and the axes."""
        Watson.__post_init__(self)
        cosine = float(linear.matmul(as_axis(self.axis, "axis"), as_axis(self.second_axis, "second_axis")))
        if abs(cosine) > SQUARE:
            raise InputError(
                f"second_axis has the cosine {cosine:.3g} with axis: they must be at right angles; give one that is"
            )

    def _principal(self, dimension: int) -> tuple[Floats, Floats]:
        """Return concentrations (d,) along the columns of a frame (d, d)."""
        first, second = (axis_in(getattr(self, name), name, dimension) for name in ("axis", "second_axis"))
        frame = np.column_stack([first, second, np.cross(first, second)])[:dimension, :dimension]
        return np.array([self.kappa, self.second_kappa, 0.0])[:dimension], frame


def bingham_directions(kappas: Floats, count: int, generator: np.random.Generator) -> Floats:
    """Draw directions x (count, d) of the density proportional to exp(sum of kappas x**2).

    By rejection with an angular central Gaussian envelope (Kent, Ganeiber & Mardia 2018,
    doi:10.1080/10618600.2017.1390468), which accepts a share that is bounded from below for all concentrations.
    """
    d, less = len(kappas), kappas.max() - kappas
    bound = float(load("scipy.optimize").brentq(lambda b: (1.0 / (b + 2.0 * less)).sum() - 1.0, 1.0, d, xtol=1e-12))
    spread, most = 1.0 / np.sqrt(1.0 + 2.0 * less / bound), 0.5 * (bound - d) + 0.5 * d * libm.log(d / bound)
    parts: list[Any] = [np.zeros((0, d))]
    missing = count
    while missing > 0:
        x = spread * generator.normal(size=(2 * missing + 8, d))
        x /= linear.norm(x, axis=1, keepdims=True)
        power = linear.matmul(x**2, less)
        kept = libm.log1p(-generator.random(len(x))) < 0.5 * d * libm.log1p(2.0 * power / bound) - power - most
        parts.append(x[kept])
        missing -= int(np.count_nonzero(kept))
    return np.concatenate(parts)[:count]


def bingham_moments(kappas: Floats) -> Floats:
    """Return the means (d,) of the squared components of directions whose density is exp(sum of kappas x**2).

    In space the integral over the angle about the axis of the largest concentration has a closed form, and that over
    the distance from its end is by the rule of Gauss on intervals that are halved towards it.
    """
    order = np.argsort(kappas, kind="stable")
    less, bessel = kappas.max() - kappas[order], load("scipy.special").ive
    if len(kappas) == 2:
        ratio = bessel(1, 0.5 * less[0]) / bessel(0, 0.5 * less[0])
        found = np.array([1.0 - ratio, 1.0 + ratio]) / 2.0
    else:
        ends = np.concatenate([[0.0], 0.5 ** np.arange(HALVINGS, -1, -1.0)])
        node, share = linear.gauss_legendre(NODES)
        half = 0.5 * np.diff(ends)[:, None]
        under = (ends[:-1, None] + half * (1.0 + node)).ravel()
        square = under * (2.0 - under)
        about = 0.5 * (less[0] - less[1]) * square
        weight = (half * share).ravel() * libm.exp(-less[1] * square)
        whole, waist = weight * bessel(0, about), weight * bessel(1, about)
        total = whole.sum()
        across, beside = (square * whole).sum() / total, (square * waist).sum() / total
        found = np.array([0.5 * (across - beside), 0.5 * (across + beside), 1.0 - across])
    return np.asarray(found[np.argsort(order, kind="stable")])


def _about(axis: Floats, along: float, dimension: int) -> Floats:
    """Return the tensor (d, d) that is `along` in the direction of an axis, of trace 1 and the same across the axis."""
    line = np.outer(axis, axis)[:dimension, :dimension]
    return np.asarray(along * line + (1.0 - along) / (dimension - 1) * (np.eye(dimension) - line))
