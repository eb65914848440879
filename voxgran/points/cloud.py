"""Point clouds: scanned surfaces before they become shapes, and packings as points with grain numbers.

Open3D thins a cloud and finds normals, outliers and clusters, in a frame that is centered and of unit size.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import (
    Floats,
    Integers,
    as_array,
    as_count,
    as_floats,
    as_length,
    as_number,
    as_points,
    as_vector,
    read_only,
)
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran._base.units import stated_unit
from voxgran.points.normals import turned_alike

#: smallest number of points of a cloud for these operations
FEWEST = 4
#: largest integer up to which every integer is a float
WHOLE = 2.0**53
#: smallest edge of the cubes of a thinned cloud, in its extents
FINEST = 1e-8


@explained_methods
@dataclass(frozen=True, eq=False)
class Cloud(ExplainedAttributes):
    """Immutable point cloud with optional normals and grain numbers.

    Attributes
    ----------
    points : (n, 3) ndarray of float
        Coordinates, in the unit of lengths.
    normals : (n, 3) ndarray of float or None
        Unit vectors; outward if estimated from points all around a body.
    grain : (n,) ndarray of int or None
        Index of the grain of each point.
    name : str
        Name in reports.
    unit : str or None
        Unit of lengths, if known.

    Raises
    ------
    InputError
        If `points` is not an (n, 3) array of finite numbers, or there is not one normal or grain for each point.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> cloud = vg.Cloud.of(np.random.default_rng(1).normal(size=(500, 3)))
    >>> len(cloud), cloud.normals is None
    (500, True)
    """

    points: Floats
    normals: Floats | None = None
    grain: Integers | None = None
    name: str = "cloud"
    unit: str | None = None

    def __post_init__(self) -> None:
        """Check the arrays."""
        many = len(as_points(self.points, "points"))
        if self.normals is not None:
            as_floats(self.normals, "normals", shape=(many, 3))
        if self.grain is not None:
            as_floats(self.grain, "grain", shape=(many,))

    @classmethod
    def of(
        cls,
        points: "ArrayLike",
        normals: "ArrayLike | None" = None,
        grain: "ArrayLike | None" = None,
        *,
        name: str = "cloud",
        unit: str | None = None,
    ) -> "Cloud":
        """Make a cloud from array-likes.

        Parameters
        ----------
        points : (n, 3) array_like of float
            Coordinates, in the unit of lengths.
        normals : (n, 3) array_like of float, optional
            Directions; they are normalized.
        grain : (n,) array_like of int, optional
            Index of the grain of each point.
        name : str
            Name in reports.
        unit : str, optional
            Unit of lengths.

        Raises
        ------
        InputError
            If an array has the wrong shape, a value is not finite, a normal is zero, or a grain is no whole number.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Cloud.of([(0, 0, 0), (1, 0, 0)], name="scan", unit="mm").points.shape
        (2, 3)
        """
        # copies, so that the caller's arrays are not made read-only
        found = np.array(as_points(points))
        directions = None
        if normals is not None:
            directions = np.array(as_floats(as_points(normals, "normals"), "normals", shape=(len(found), 3)))
            lengths = linear.norm(directions, axis=1)
            if (lengths == 0).any():
                raise InputError(
                    f"normal {int(lengths.argmin())} has length 0: a normal is a direction; leave normals out instead"
                )
            directions = read_only(directions / lengths[:, None])
        labels = None
        if grain is not None:
            numbers = as_floats(grain, "grain", shape=(len(found),))
            odd = numbers[(numbers != np.rint(numbers)) | (np.abs(numbers) > WHOLE)]
            if len(odd):
                raise InputError(f"grain is {odd[0]:g}: numbers of grains are whole and at most 2^53; number anew")
            labels = read_only(numbers.astype(np.int64))
        return cls(read_only(found), directions, labels, name, stated_unit(unit))

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    def __repr__(self) -> str:
        """Return name and number of points."""
        return f"Cloud({self.name!r}, {len(self)} points)"

    @cached_property
    def spacing(self) -> float:
        """Mean spacing: the side of the square of surface area per point, in the unit of lengths.

        It follows from the median distance to the 12th neighbour, within which twelve other points lie.
        """
        different = np.unique(self.points, axis=0)
        if len(different) < FEWEST:
            return 0.0
        neighbours = min(12, len(different) - 1)
        distance = load("scipy.spatial").cKDTree(different).query(different, k=[neighbours + 1])[0]
        return float(np.median(distance) * np.sqrt(np.pi / neighbours))

    def chosen(self, mask: "ArrayLike") -> "Cloud":
        """Return a subset of the points.

        Parameters
        ----------
        mask : (n,) array_like of bool, or array_like of int
            Mask or indices of the points.

        Raises
        ------
        InputError
            If it is neither a mask of all points nor a list of their indices.

        Examples
        --------
        >>> import voxgran as vg
        >>> cloud = vg.Cloud.of([(0, 0, 0), (1, 0, 0), (5, 0, 0)])
        >>> len(cloud.chosen(cloud.points[:, 0] < 2))
        2
        """
        kept = as_array(mask, "mask")
        if kept.dtype.kind not in "bui" or (kept.dtype.kind == "b" and kept.shape != (len(self),)) or kept.ndim != 1:
            raise InputError(
                f"mask is {shown(mask)}: it must be a mask of the {len(self)} points or a list of numbers; give one"
            )
        if kept.size and kept.dtype.kind != "b" and not -len(self) <= kept.min() <= kept.max() < len(self):
            raise InputError(f"mask is {shown(mask)}: the points have the numbers 0 ... {len(self) - 1}; give these")
        parts = (self.normals, self.grain)
        normals, grain = (None if part is None else read_only(part[kept]) for part in parts)
        return replace(self, points=read_only(self.points[kept]), normals=normals, grain=grain)

    def cropped(self, lower: "ArrayLike", upper: "ArrayLike") -> "Cloud":
        """Return the points within a box.

        Parameters
        ----------
        lower, upper : (3,) array_like of float
            Corners of the closed box, in the unit of lengths.

        Raises
        ------
        InputError
            If `lower` is above `upper`.

        Examples
        --------
        >>> import voxgran as vg
        >>> len(vg.Cloud.of([(0, 0, 0), (1, 0, 0), (5, 0, 0)]).cropped((-1, -1, -1), (2, 1, 1)))
        2
        """
        low, high = as_vector(lower, "lower"), as_vector(upper, "upper")
        if (low > high).any():
            raise InputError(f"lower is {low.tolist()} and upper {high.tolist()}: no part may be above; exchange them")
        return self.chosen(((self.points >= low) & (self.points <= high)).all(axis=1))

    def thinned(self, spacing: float) -> "Cloud":
        """Return one point for each cube of a grid: the mean of the points in it.

        Parameters
        ----------
        spacing : float
            Edge of the cubes, in the unit of lengths. Points of several grains are not mixed.

        Raises
        ------
        InputError
            If `spacing` is not above 0, or far below the extent of the cloud.

        Examples
        --------
        >>> import voxgran as vg
        >>> len(vg.Cloud.of([(0.1, 0, 0), (0.2, 0, 0), (5.1, 0, 0)]).thinned(1.0))
        2
        """
        edge = as_length(spacing, "spacing")
        if edge < FINEST * Frame.around(self.points).size:
            raise InputError(f"spacing is {edge:g}: it is below {FINEST:g} of the cloud's extent; raise it")
        if self.grain is not None:
            parts = [self.chosen(self.grain == label) for label in np.unique(self.grain).tolist()]
            thin = [replace(part, grain=None).thinned(edge) for part in parts]
            many = np.repeat([int(part.grain[0]) for part in parts if part.grain is not None], [len(p) for p in thin])
            normals = None if self.normals is None else np.concatenate([np.asarray(part.normals) for part in thin])
            points = np.concatenate([part.points for part in thin]) if thin else self.points
            return Cloud.of(points, normals, many, name=self.name, unit=self.unit)
        frame = Frame.around(self.points)
        made = frame.to_open3d(self).voxel_down_sample(edge / frame.size)
        points, normals = frame.back(np.asarray(made.points)), None
        if self.normals is not None:
            normals = np.array(made.normals)
            # normals of both sides of a plate may cancel; then that of the nearest point is used
            none = linear.norm(normals, axis=1) < 0.1
            normals[none] = self.normals[load("scipy.spatial").cKDTree(self.points).query(points[none])[1]]
        return Cloud.of(points, normals, name=self.name, unit=self.unit)

    def without_outliers(self, deviations: float = 2.0, *, neighbours: int = 20) -> "Cloud":
        """Return the cloud without outliers, by the mean distance of each point to its neighbours.

        Parameters
        ----------
        deviations : float
            Number of standard deviations above the average at which the mean distance of a point makes it an outlier.
        neighbours : int
            Number of neighbours of each point.

        Raises
        ------
        InputError
            If `deviations` is not above 0 or `neighbours` below 1.

        Examples
        --------
        >>> import numpy as np
        >>> import voxgran as vg
        >>> points = np.vstack([np.random.default_rng(1).random((500, 3)), [[9.0, 9.0, 9.0]]])
        >>> cloud = vg.Cloud.of(points).without_outliers(deviations=10.0)
        >>> bool((cloud.points < 2).all())
        True
        """
        many = min(as_count(neighbours, "neighbours", at_least=1), len(self))
        ratio = as_number(deviations, "deviations", above=0.0)
        if len(self) < FEWEST:
            return self
        _, kept = Frame.around(self.points).to_open3d(self).remove_statistical_outlier(many, ratio)
        return self.chosen(np.asarray(kept, dtype=np.int64))

    def with_normals(self, neighbours: int = 30) -> "Cloud":
        """Return the cloud with normals of planes fitted to neighbours, oriented consistently and outward.

        Parameters
        ----------
        neighbours : int
            Number of neighbours of each plane, at least 3.

        Raises
        ------
        InputError
            If there are fewer points than neighbours, or fewer than 4.

        Examples
        --------
        >>> import voxgran as vg
        >>> cloud = vg.Cloud.of(vg.sample_surface(vg.shapes.box(lengths=(1, 1, 1)), spacing=0.2))
        >>> cloud.with_normals().normals.shape == cloud.points.shape
        True
        """
        many = as_count(neighbours, "neighbours", at_least=3)
        if len(self) <= many:
            raise InputError(
                f"the cloud has {len(self)} points and neighbours is {many}: it needs more points than that; lower it"
            )
        open3d, frame = load("open3d"), Frame.around(self.points)
        made = frame.to_open3d(replace(self, normals=None))
        made.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(many))
        normals = turned_alike(self.points, np.array(made.normals), min(many, 15))
        return replace(self, normals=read_only(normals))

    def clusters(self, distance: float | None = None, *, min_points: int = 10) -> list["Cloud"]:
        """Return the clusters of a cloud, the largest first, without isolated points.

        Parameters
        ----------
        distance : float, optional
            Largest distance of neighbours, in the unit of lengths. Default: three spacings.
        min_points : int
            Smallest number of points within that distance for a point to be the core of a cluster.

        Returns
        -------
        list of Cloud
            One cloud per cluster, with `grain` 0, 1, ...

        Raises
        ------
        InputError
            If `distance` is not above 0 or `min_points` below 1.

        References
        ----------
        Ester, Kriegel, Sander & Xu 1996, A density-based algorithm for discovering clusters in large spatial databases
        with noise, Proc. 2nd Int. Conf. Knowledge Discovery and Data Mining (KDD-96), 226.

        Examples
        --------
        >>> import numpy as np
        >>> import voxgran as vg
        >>> points = np.random.default_rng(1).random((400, 3))
        >>> points[:200] += 5.0
        >>> [len(part) for part in vg.Cloud.of(points).clusters(distance=0.5)]
        [200, 200]
        """
        least = as_count(min_points, "min_points", at_least=1)
        reach = 3.0 * self.spacing if distance is None else as_length(distance, "distance")
        if len(self) < FEWEST or reach == 0.0:
            return []
        frame = Frame.around(self.points)
        labels = np.asarray(frame.to_open3d(self).cluster_dbscan(reach / frame.size, least))
        order = np.argsort(-np.bincount(labels[labels >= 0]), kind="stable").tolist()
        return [
            replace(self.chosen(labels == label), grain=read_only(np.full(int((labels == label).sum()), k)))
            for k, label in enumerate(order)
        ]


@dataclass(frozen=True, slots=True)
class Frame:
    """Frame in which points are centered and of unit size."""

    center: Floats  # (3,) origin of the frame
    size: float  # unit of length of the frame

    @classmethod
    def around(cls, points: Floats) -> "Frame":
        """Return the frame of points (n, 3)."""
        if not len(points):
            return cls(np.zeros(3), 1.0)
        low, high = points.min(axis=0), points.max(axis=0)
        return cls((low + high) / 2, float((high - low).max()) or 1.0)

    def into(self, points: Floats) -> Floats:
        """Return points transformed to this frame."""
        return np.asarray((points - self.center) / self.size)

    def back(self, points: Floats) -> Floats:
        """Return points of this frame in the original frame."""
        return np.asarray(points * self.size + self.center)

    def to_open3d(self, cloud: Cloud) -> Any:
        """Return a cloud as an object of Open3D, in this frame."""
        open3d = load("open3d")
        made = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(self.into(cloud.points)))
        if cloud.normals is not None:
            made.normals = open3d.utility.Vector3dVector(np.array(cloud.normals))
        return made
