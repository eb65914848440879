"""Distributions of orientations, by name: ``vg.orientations.watson("z", 4)``.

A distribution is one of the directions of an axis of the grains, by default of the long principal axis of each shape,
which has the smallest moment of inertia; the rotation about it is uniform. In two dimensions directions are in the
plane. Each grain has the orientation that is drawn for it wherever it finds a place. The classes are in
:mod:`voxgran.geometry.orientation_laws`.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import ArrayLike

from voxgran._base import missing_names
from voxgran._base.arrays import as_floats, as_number, as_quaternions, float_array
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping, kind_of
from voxgran._base.errors import InputError, shown
from voxgran.geometry.orientation_laws.directional import Aligned, Bingham, Fisher, Random, Watson
from voxgran.geometry.orientation_laws.fibres import Tensor
from voxgran.geometry.orientation_laws.given import Given
from voxgran.geometry.orientation_laws.law import OrientationLaw

__all__ = [
    "OrientationLaw",
    "aligned",
    "bingham",
    "fisher",
    "given",
    "make_orientations",
    "orientation_kinds",
    "random",
    "tensor",
    "watson",
]

BodyAxis = Literal["long", "short"] | ArrayLike

if not TYPE_CHECKING:
    __getattr__ = missing_names(__name__)


@explained(hint="random()")
def random() -> Random:
    """Return the uniform distribution over all orientations, which is the default.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.orientations.random().moment(dimension=2).tolist()
    [[0.5, 0.0], [0.0, 0.5]]
    """
    return Random()


@explained(hint='aligned("z")')
def aligned(axis: "ArrayLike", *, body_axis: BodyAxis = "long") -> Aligned:
    """Return orientations in which all bodies point along one axis.

    Parameters
    ----------
    axis : str or (3,) array_like of float
        Axis in the container: ``"x"``, ``"-z"`` and so on, or a vector of any length; in two dimensions (2,).
    body_axis : {"long", "short"} or (3,) array_like of float
        Axis of the body: the principal axis of the smallest moment of inertia, of the largest one, as of plates, or a
        vector in the frame of the shape.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If an axis is neither a name nor a vector, or its length is 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> rod, box = vg.shapes.ellipsoid(semi_axes=(0.4, 0.4, 1.6)), vg.Box((9, 9, 9))
    >>> bed = vg.pack(rod, box, "rsa", count=10, orientations=vg.orientations.aligned("x"))
    >>> bed.measure("fabric")["fabric"]["orientation_tensor"].values.round(6).diagonal().tolist()
    [1.0, 0.0, 0.0]
    """
    return Aligned(axis=_plain(axis), body_axis=_plain(body_axis))


@explained(hint='fisher("z", 10)')
def fisher(axis: "ArrayLike", kappa: float, *, body_axis: BodyAxis = "long") -> Fisher:
    """Return the distribution of Fisher (von Mises and Fisher), for bodies of which the two ends differ.

    The density of a direction n is proportional to exp(kappa n . m), with the axis m. In two dimensions it is that of
    von Mises. Arguments are those of :func:`aligned`; kappa is the concentration, at least 0. The sense of a principal
    axis is the one in which its largest component in the frame of the shape is positive.

    Raises
    ------
    InputError
        If kappa is not from 0 to 1e12, an axis is neither a name nor a vector, or its length is 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.orientations.fisher("z", 10).moment(dimension=3).round(6).diagonal().tolist()
    [0.09, 0.09, 0.82]
    """
    return Fisher(axis=_plain(axis), kappa=as_number(kappa, "kappa"), body_axis=_plain(body_axis))


@explained(hint='watson("z", 4)')
def watson(axis: "ArrayLike", kappa: float, *, body_axis: BodyAxis = "long") -> Watson:
    """Return the distribution of Watson, in which both senses of an axis are equally likely.

    The density of a direction n is proportional to exp(kappa (n . m)^2), with the axis m. With kappa above 0
    directions are about the axis, below 0 about the plane across it (a girdle). In two dimensions it is that of von
    Mises for the doubled angle. Other arguments are those of :func:`aligned`.

    Raises
    ------
    InputError
        If kappa is not within 1e12, an axis is neither a name nor a vector, or its length is 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.orientations.watson("z", 4).moment(dimension=3).round(3).diagonal().tolist()
    [0.148, 0.148, 0.705]
    """
    return Watson(axis=_plain(axis), kappa=as_number(kappa, "kappa"), body_axis=_plain(body_axis))


@explained(hint='bingham("z", 4, "x", second_kappa=-2)')
def bingham(
    axis: "ArrayLike", kappa: float, second_axis: "ArrayLike", *, second_kappa: float, body_axis: BodyAxis = "long"
) -> Bingham:
    """Return the distribution of Bingham: that of Watson with another concentration along a second axis.

    The density of a direction n is proportional to exp(kappa (n . m)^2 + second_kappa (n . s)^2), with the axes m and s
    at right angles. Other arguments are those of :func:`aligned`.

    Raises
    ------
    InputError
        If a concentration is not within 1e12, an axis is neither a name nor a vector, its length is 0, or the axes are
        not at right angles.

    Examples
    --------
    >>> import voxgran as vg
    >>> law = vg.orientations.bingham("z", 4, "x", second_kappa=-2)
    >>> law.moment(dimension=3).round(3).diagonal().tolist()
    [0.096, 0.15, 0.754]
    """
    numbers = {"kappa": as_number(kappa, "kappa"), "second_kappa": as_number(second_kappa, "second_kappa")}
    return Bingham(axis=_plain(axis), second_axis=_plain(second_axis), body_axis=_plain(body_axis), **numbers)


@explained(hint="tensor([[0.7, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])")
def tensor(matrix: "ArrayLike", *, body_axis: BodyAxis = "long") -> Tensor:
    """Return directions n of which the mean of n n is a given orientation tensor, as it is used for short fibres.

    The distribution is the angular central Gaussian one: that of fibres without interaction which were isotropic once,
    in any flow.

    Parameters
    ----------
    matrix : (3, 3) array_like of float
        Orientation tensor of second order: symmetric, of trace 1, with principal values of at least 0. In two
        dimensions (2, 2).
    body_axis : {"long", "short"} or (3,) array_like of float
        Axis of the body, as in :func:`aligned`.

    Raises
    ------
    InputError
        If the matrix is not a symmetric one of 3 x 3 or 2 x 2 numbers, its trace is not 1, or a principal value is
        negative.

    References
    ----------
    Tyler 1987, doi:10.1093/biomet/74.3.579 (the distribution); Montgomery-Smith et al. 2010, Exact tensor closures for
    the three dimensional Jeffery's equation, arXiv:2106.10805 (fibres).

    Examples
    --------
    >>> import voxgran as vg
    >>> law = vg.orientations.tensor([[0.7, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
    >>> law.moment(dimension=3).round(6).diagonal().tolist()
    [0.7, 0.2, 0.1]
    """
    given = float_array(matrix)
    if given is not None and given.ndim == 1:
        raise InputError(
            f"matrix is {shown(matrix)}: it must have three rows of three numbers; of principal values along the axes "
            "give numpy.diag"
        )
    rows = as_floats(matrix, "matrix", shape=(None, None)).tolist()
    return Tensor(matrix=tuple(tuple(row) for row in rows), body_axis=_plain(body_axis))


@explained(hint="given([[1, 0, 0, 0]])")
def given(quaternions: "ArrayLike") -> Given:
    """Return a list of orientations, one for each grain, such as those of a list of `grains`, in its order.

    Parameters
    ----------
    quaternions : (n, 4) array_like of float
        Unit quaternions (w, x, y, z), each from the frame of the shape to the container.

    Raises
    ------
    InputError
        If the shape of the array is another, or a length differs from 1 by more than 1e-6.

    Examples
    --------
    >>> import voxgran as vg
    >>> rods = [vg.shapes.ellipsoid(semi_axes=(1, 1, 2))] * 2
    >>> turns = vg.orientations.given([[1, 0, 0, 0], [0, 1, 0, 0]])
    >>> vg.pack(grains=rods, container=vg.Box((9, 9, 9)), method="rsa", orientations=turns).orientation.tolist()
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]
    """
    return Given(quaternions=tuple(tuple(row) for row in as_quaternions(quaternions, "quaternions").tolist()))


def _plain(axis: Any) -> Any:
    """Return an axis as text or a tuple of numbers."""
    return axis if isinstance(axis, str) else tuple(as_floats(axis, "axis", shape=(None,)).tolist())


@explained(hint="orientation_kinds()")
def orientation_kinds() -> tuple[str, ...]:
    """Return the kinds of distributions, the values of `kind` in scene files.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.orientations.orientation_kinds()
    ('aligned', 'bingham', 'fisher', 'given', 'random', 'tensor', 'watson')
    """
    return tuple(sorted(KINDS))


@explained(hint='make_orientations({"kind": "watson", "axis": "z", "kappa": 4})')
def make_orientations(mapping: Mapping[str, Any], where: str = "[orientations]") -> OrientationLaw:
    """Make a distribution from kind and parameters, as in scene files.

    Parameters
    ----------
    mapping : mapping
        ``kind`` and the parameters of that kind.
    where : str
        Name of the mapping in messages.

    Returns
    -------
    OrientationLaw

    Raises
    ------
    UnknownNameError
        If the kind or a parameter is not known.
    InputError
        If the kind is missing, or a parameter is missing or invalid.

    Examples
    --------
    >>> import voxgran as vg
    >>> made = vg.orientations.make_orientations({"kind": "watson", "axis": "z", "kappa": 4})
    >>> made == vg.orientations.watson("z", 4)
    True
    """
    return from_mapping(*kind_of(mapping, KINDS, where, example="{'kind': 'aligned', 'axis': 'z'}"), where)


#: classes of distributions by kind
KINDS: dict[str, type[OrientationLaw]] = {
    law.kind: law for law in (Aligned, Bingham, Fisher, Given, Random, Tensor, Watson)
}
