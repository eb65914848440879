"""Parameters of control-point packing."""

from dataclasses import dataclass
from typing import Literal

from voxgran._base.calls import explained_methods
from voxgran._base.config import parameter
from voxgran._base.errors import InputError
from voxgran.packing.walking.parameters import Walking

#: shortest step, in diameters of the grain
SHORTEST_STEP = 0.002


@explained_methods
@dataclass(frozen=True, kw_only=True)
class ControlPoint(Walking):
    """Parameters of control-point packing.

    Parameters
    ----------
    spacing
        spacing of the control points on a grain; touching grains stay apart by up to this distance.
    contact
        contact test: control points of one grain in the signed-distance field of the other (sdf), or distances between
        the control points of both, found with k-d trees (kdtree).
    points
        where control points lie: on the surface with its edges and corners, or in the interior as well.
    tested_points
        which control points are tested against the other grain's signed distance: those of both grains, or only those
        of the finer-sampled one.
    distance
        distance that the surfaces of grains keep at least; sharp edges between control points may come closer by less
        than half the spacing.
    overlap
        depth up to which grains may overlap, as a model of deformable grains; with contact 'sdf' only.
    gravity_bias
        length of the vector along gravity that is added to the random unit vector of each step.
    vibration
        how the bed is vibrated: a fraction of all steps may go upward (cycles), or a grain makes three steps that lean
        upward after a fraction of its collisions (collision).
    vibration_up
        that fraction at the beginning of the first vibration cycle.
    rotation_share
        fraction of the attempts that also rotate the grain.
    step
        largest step length; steps are never longer than half the ratio of volume to surface area of the grain.

    Raises
    ------
    InputError
        If a number is out of its range, or parameters do not go together.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 5)), vg.methods.ControlPoint(sweeps=20), count=5).count
    5
    """

    spacing: float = parameter(0.12, unit="diameters of the grain", above=0.0, at_most=1.0)
    contact: Literal["sdf", "kdtree"] = parameter("sdf")
    points: Literal["surface", "all"] = parameter("surface")
    tested_points: Literal["both", "one"] = parameter("both")
    distance: float = parameter(0.0, unit="length", at_least=0.0)
    overlap: float = parameter(0.0, unit="length", at_least=0.0)
    gravity_bias: float = parameter(0.5, at_least=0.0)
    vibration: Literal["cycles", "collision"] = parameter("cycles")
    vibration_up: float = parameter(0.8, at_least=0.0, at_most=1.0)
    rotation_share: float = parameter(0.7, at_least=0.0, at_most=1.0)
    step: float = parameter(0.1, unit="diameters of the grain", at_least=SHORTEST_STEP)

    def __post_init__(self) -> None:
        """Check the ranges, and that the parameters go together."""
        super().__post_init__()
        if self.overlap and (self.contact != "sdf" or self.distance):
            raise InputError(
                f"overlap is {self.overlap:g} with contact {self.contact!r} and distance {self.distance:g}: grains may "
                "overlap with contact 'sdf' only, without distance"
            )
        if self.tested_points == "one" and self.contact != "sdf":
            raise InputError(
                f"tested_points is 'one' with contact {self.contact!r}: points are compared with points; use 'both'"
            )
