"""The distribution of directions that has a given orientation tensor, as it is used for short fibres.

It is the angular central Gaussian one (Tyler 1987, doi:10.1093/biomet/74.3.579): the directions of vectors of a normal
distribution. That is how fibres without interaction that were isotropic once are oriented in any flow (Jeffery's
equation), and the tensor is then an elliptic integral of the variances (Montgomery-Smith et al. 2010,
arXiv:2106.10805).
"""

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, as_floats
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran.geometry.orientation_laws.law import OrientationLaw, in_space

#: rounding of trace, symmetry and principal values of a tensor, and the principal values that are taken for 0
ROUNDING, NONE = 1e-6, 1e-12
#: power by which variances follow the ratio of principal values: 5/3 is quadratically convergent for an isotropic
#: tensor, 2 for a line; and steps
POWER, STEPS = 1.8, 2000


@parameter_class
class Tensor(OrientationLaw):
    """Directions n whose mean of n n is a given tensor.

    Parameters
    ----------
    matrix
        orientation tensor of second order, rows of a symmetric matrix of trace 1, in the plane of 2 x 2 numbers.

    Raises
    ------
    InputError
        If the matrix is not a symmetric one of 3 x 3 or 2 x 2 numbers, its trace is not 1 or a principal value is
        negative.
    """

    kind: ClassVar[str] = "tensor"

    matrix: tuple[tuple[float, ...], ...] = parameter()

    def __post_init__(self) -> None:
        """Check the tensor."""
        OrientationLaw.__post_init__(self)
        principal(self.matrix)

    def directions(self, count: int, generator: np.random.Generator, *, dimension: int) -> Floats:
        """Draw directions of vectors of a normal distribution."""
        values, frame = self._principal(dimension)
        spread = np.sqrt(variances_of(values))
        return in_space(linear.matmul(generator.normal(size=(count, dimension)) * spread, frame.T))

    def moment(self, *, dimension: int) -> Floats:
        """Return the tensor itself."""
        values, frame = self._principal(dimension)
        return np.asarray(linear.matmul(frame * values, frame.T))

    def _principal(self, dimension: int) -> tuple[Floats, Floats]:
        """Return principal values (d,) and the frame (d, d) with the principal axes as columns."""
        values, frame = principal(self.matrix)
        if len(values) != dimension:
            raise InputError(
                f"matrix has {len(values)} x {len(values)} numbers: in {dimension} dimensions it must have "
                f"{dimension} x {dimension}; give those"
            )
        return values, frame


def principal(matrix: "ArrayLike") -> tuple[Floats, Floats]:
    """Return the principal values of an orientation tensor, of sum 1, and its principal axes as columns.

    Raises
    ------
    InputError
        If it is not symmetric of 3 x 3 or 2 x 2 numbers, its trace is not 1 or a principal value is negative.
    """
    given = as_floats(matrix, "matrix", shape=(None, None))
    if given.shape not in ((2, 2), (3, 3)):
        raise InputError(f"matrix has shape {given.shape}: an orientation tensor has 3 x 3 numbers, in 2D 2 x 2")
    uneven, trace = float(np.abs(given - given.T).max()), float(np.trace(given))
    if uneven > ROUNDING:
        raise InputError(f"matrix differs by {uneven:.3g} from its transpose: it must be symmetric; correct it")
    if abs(trace - 1.0) > ROUNDING:
        raise InputError(f"matrix has the trace {trace:.6g}: an orientation tensor has the trace 1; divide it by that")
    values, frame = linear.eigh(0.5 * (given + given.T))
    if values[0] < -ROUNDING:
        raise InputError(
            f"matrix has the principal values {shown(values.round(6).tolist())}: means of squares are not negative; "
            "correct it"
        )
    values = np.where(values < NONE, 0.0, values)
    return values / values.sum(), frame


def variances_of(values: Floats) -> Floats:
    """Return the variances (d,) of normal variables whose directions have given means of the squared components.

    Where two of these are not 0, the variances are as their squares; three are found by iteration.
    """
    found = np.square(values)
    if np.count_nonzero(values) < 3:
        return found
    for _ in range(STEPS):
        got = squares_of(found)
        found *= libm.power(values / got, POWER)
        found /= found.max()
        if np.abs(got - values).max() <= 4e-16 or np.abs(got / values - 1.0).max() <= 1e-13:
            break
    return found


def squares_of(variances: Floats) -> Floats:
    """Return the means (3,) of the squared components of the directions of normal variables of these variances."""
    inverse = 1.0 / variances
    elliptic = load("scipy.special").elliprd
    parts = [elliptic(inverse[i - 2], inverse[i - 1], inverse[i]) for i in range(3)]
    return np.asarray(np.sqrt(inverse.prod()) * np.array(parts) / 3.0)
