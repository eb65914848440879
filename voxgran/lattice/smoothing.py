"""Fields smoothed by a Gaussian, with the same bits on every processor."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.lazy import load


def smoothed(
    field: Any, width: float, orders: Sequence[int] | None = None, *, mode: str = "reflect", truncate: float = 4.0
) -> Any:
    """Return a field convolved with a Gaussian, as `scipy.ndimage.gaussian_filter` does.

    SciPy computes the weights by `numpy.exp`, whose last digits depend on the processor.

    Parameters
    ----------
    field : ndarray of float
        Values at voxels.
    width : float
        Standard deviation, in voxels; 0 leaves the field as it is.
    orders : sequence of int, optional
        For each axis 0, or 1 for the first derivative.
    mode : str
        What lies beyond the border, as in SciPy.
    truncate : float
        Standard deviations up to which the Gaussian reaches.
    """
    if width == 0.0:
        return field
    reach = int(truncate * width + 0.5)
    place = np.arange(-reach, reach + 1)
    weights = libm.exp(-0.5 * (place / width) ** 2)
    weights /= weights.sum()
    for axis, order in enumerate(orders or [0] * field.ndim):
        factors = weights * place / width**2 if order else weights
        field = load("scipy.ndimage").correlate1d(field, factors, axis, mode=mode)
    return field
