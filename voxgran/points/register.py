"""Registration of two scans: the rigid motion that aligns one cloud with the other."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_count, as_length, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.points.backend_open3d import seed_open3d
from voxgran.points.cloud import Cloud, Frame
from voxgran.points.normals import turned_alike

#: edge of the cubes of the thinned clouds, in extents of the target
COARSE = 0.04
#: smallest share of the points with a partner
LEAST_OVERLAP = 0.3
#: largest number of draws of three pairs, and the confidence at which they end
DRAWS, CONFIDENCE = 400_000, 0.999
#: change at which the refinement ends, and its largest number of steps
CHANGE, STEPS = 1e-10, 200
#: smallest number of points of a cloud
FEWEST = 50
#: smallest distance at which partners are searched, in sizes of the target
FINEST = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Registration(ExplainedAttributes):
    """Rigid motion from one cloud to another, with its quality.

    Attributes
    ----------
    rotation : (3, 3) ndarray of float
        Rotation matrix, applied first.
    translation : (3,) ndarray of float
        Translation, applied after the rotation, in the unit of lengths.
    overlap : float
        Share of the points of the first cloud with a partner, in [0, 1].
    residual : float
        Root mean square distance of the partners, in the unit of lengths.
    """

    rotation: Floats
    translation: Floats
    overlap: float
    residual: float

    def moved(self, cloud: Cloud) -> Cloud:
        """Return a cloud transformed by this motion.

        Parameters
        ----------
        cloud : Cloud
            Cloud in the frame of the first one.
        """
        normals = None if cloud.normals is None else linear.matmul(cloud.normals, self.rotation.T)
        points = linear.matmul(cloud.points, self.rotation.T) + self.translation
        return Cloud.of(points, normals, cloud.grain, name=cloud.name, unit=cloud.unit)


@explained(hint="register_clouds(cloud, target, distance=0.1)")
def register_clouds(cloud: Cloud, target: Cloud, *, distance: float | None = None, seed: int = 0) -> Registration:
    """Find the rigid motion that aligns one scan with another of the same body, from any initial pose.

    Points with similar neighbourhoods (fast point feature histograms) are paired at random until a motion fits many of
    them; this motion is refined by minimizing the distances of points from the tangent planes of their partners.

    Parameters
    ----------
    cloud : Cloud
        Scan to move.
    target : Cloud
        Fixed scan. Both may be partial if they overlap by a third or more.
    distance : float, optional
        Largest distance of partners after the first fit, in the unit of lengths. Default: 4 % of the extent of the
        target.
    seed : int
        Seed of the random pairs.

    Returns
    -------
    Registration
        The motion and its quality.

    Raises
    ------
    InputError
        If the clouds have different units, a cloud has fewer than 50 points, or fewer after thinning to cubes of edge
        `distance`, `distance` is not above 0, the seed is not a whole number of at least 0, or less than 30 % of the
        points have a partner.

    References
    ----------
    Rusu, Blodow & Beetz 2009, Fast point feature histograms (FPFH) for 3D registration,
    doi:10.1109/ROBOT.2009.5152473. Chen & Medioni 1992, Object modelling by registration of multiple range images,
    doi:10.1016/0262-8856(92)90066-C.

    Examples
    --------
    >>> import voxgran as vg
    >>> points = vg.sample_surface(vg.shapes.ellipsoid(semi_axes=(3, 2, 1)), spacing=0.4)
    >>> scan = vg.Cloud.of(points)
    >>> motion = vg.register_clouds(vg.Cloud.of(points + [5.0, 0.0, 0.0]), scan, seed=1)
    >>> round(motion.overlap, 2)
    1.0
    """
    for name, one in (("cloud", cloud), ("target", target)):
        check_type(one, Cloud, name, "a Cloud; load_cloud reads one")
        if len(one) < FEWEST:
            raise InputError(f"{one.name} has {len(one)} points: registration needs {FEWEST} or more; scan more finely")
    if cloud.unit != target.unit and None not in (cloud.unit, target.unit):
        raise InputError(
            f"{cloud.name} has lengths in {cloud.unit} and {target.name} in {target.unit}: both scans must have one "
            "unit; convert the points of one"
        )
    frame = Frame.around(target.points)
    reach = COARSE if distance is None else as_length(distance, "distance") / frame.size
    if reach < FINEST:
        raise InputError(f"distance is {reach * frame.size:g}: it must be a millionth of the target or more; raise it")
    open3d = load("open3d")
    tools = open3d.pipelines.registration
    seed_open3d(as_count(seed, "seed", at_most=None))
    # each in its own frame, with the same unit
    own = Frame(Frame.around(cloud.points).center, frame.size)
    source, features = _features(cloud, own, reach)
    base, base_features = _features(target, frame, reach)
    for one, thin in ((cloud, source), (target, base)):
        if len(thin.points) < FEWEST:
            raise InputError(
                f"{one.name} has {len(thin.points)} points left in cubes of {reach * frame.size:.4g}: {FEWEST} or more "
                "are needed; bring both scans to one unit, or lower distance"
            )
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        found = _fitted(tools, (own, cloud, source, features), (frame, target, base, base_features), reach)
    if found.fitness < LEAST_OVERLAP:
        raise InputError(
            f"{cloud.name} finds partners in {target.name} for {100 * found.fitness:.0f} % of its points: "
            f"{100 * LEAST_OVERLAP:.0f} % are needed; give scans that overlap more, or raise distance"
        )
    motion = np.asarray(found.transformation)
    rotation = np.array(motion[:3, :3])
    translation = frame.back(motion[:3, 3]) - linear.matmul(rotation, own.center)
    return Registration(
        rotation=rotation,
        translation=np.asarray(translation),
        overlap=float(found.fitness),
        residual=float(found.inlier_rmse) * frame.size,
    )


def _fitted(tools: Any, moved: tuple[Any, ...], fixed: tuple[Any, ...], reach: float) -> Any:
    """Return the refined motion from pairs of features; each side is frame, cloud, thinned cloud and features."""
    own, cloud, source, features = moved
    frame, target, base, base_features = fixed
    rough = tools.registration_ransac_based_on_feature_matching(
        source, base, features, base_features, True, 1.5 * reach, tools.TransformationEstimationPointToPoint(False), 3,
        [tools.CorrespondenceCheckerBasedOnEdgeLength(0.9), tools.CorrespondenceCheckerBasedOnDistance(1.5 * reach)],
        tools.RANSACConvergenceCriteria(DRAWS, CONFIDENCE),
    )  # fmt: skip
    fine = frame.to_open3d(target if target.normals is not None else target.with_normals(min(30, len(target) - 1)))
    return tools.registration_icp(
        own.to_open3d(replace(cloud, normals=None)), fine, reach, rough.transformation,
        tools.TransformationEstimationPointToPlane(), tools.ICPConvergenceCriteria(CHANGE, CHANGE, STEPS),
    )  # fmt: skip


def _features(cloud: Cloud, frame: Frame, reach: float) -> tuple[Any, Any]:
    """Return a thinned cloud and the features of its points."""
    open3d = load("open3d")
    thin = frame.to_open3d(replace(cloud, normals=None)).voxel_down_sample(reach)
    thin.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(2 * reach, 30))
    normals = turned_alike(np.asarray(thin.points), np.array(thin.normals), 15)
    thin.normals = open3d.utility.Vector3dVector(normals)
    around = open3d.geometry.KDTreeSearchParamHybrid(5 * reach, 100)
    return thin, open3d.pipelines.registration.compute_fpfh_feature(thin, around)
