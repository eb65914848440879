"""How deep a bed will be, and how many grains its bulk will hold, before anything is packed."""

import logging
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import PackingWarning, warn
from voxgran._base.progress import OnStep, Step, reported
from voxgran._base.seeds import stream
from voxgran.containers.gravity import gravity_vector
from voxgran.packing.beds.filling import AT_SURFACE, AT_WALLS, highest_surface, mean_diameter, usual_solid_fraction
from voxgran.packing.beds.reachable import reachable
from voxgran.packing.beds.seeds import container_levels, points_inside
from voxgran.packing.missed import Task
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.settling.parameters import Settling

log = logging.getLogger(__name__)

#: distance of the bulk from the walls, in median diameters, share of the volume of the grains below its surface, and
#: number of grains that it must hold for a solid fraction, as in :mod:`voxgran.measures.registered.density`
INSET, HELD, FEWEST = 1.5, 0.85, 50
#: share of the grains of a bed that have their tops below its surface, and share of a height up to which it is met
BELOW, MET = 0.95, 0.05


@dataclass(frozen=True, slots=True)
class ExpectedBed:
    """Depth of a bed, in median diameters, and number of grains in its bulk, both estimated to about 10 percent."""

    depth: float
    bulk: int

    def __str__(self) -> str:
        """Return it as a person reads it."""
        return f"about {self.depth:.1f} median diameters deep, with about {self.bulk} grains in its bulk"

    @property
    def note(self) -> str:
        """That the bed has no bulk; empty where it has one."""
        if self.bulk >= FEWEST:
            return ""
        return (
            f"the bed is expected to be {self}: at least {FEWEST} are needed for a bulk solid fraction, {INSET:g} "
            "diameters from walls and surface; give more grains, and a container more than three diameters across"
        )


def tell_of_bed(problem: Problem, on_step: OnStep | None, gravity: Floats | None = None) -> None:
    """Tell how deep a bed will be; warn where a solid fraction is asked of it and it will have no bulk."""
    bed = expected_bed(problem, gravity)
    if bed is None:
        return
    log.info("the bed is expected to be %s", bed)
    if (told := reported(on_step)) is not None:
        told(Step(stage="expected bed", done=0, total=0, text=str(bed)))
    settling = problem.settling or problem.parameters
    if bed.note and settling.solid_fraction is not None:
        warn(bed.note, PackingWarning)


def expected_bed(problem: Problem, gravity: Floats | None = None) -> ExpectedBed | None:
    """Return the bed that is expected, under a gravity (3,) that the parameters do not tell; None where grains form
    none, since there is no gravity, or none settle.
    """
    problem = reachable(problem)
    settings = problem.parameters
    settling = settings if isinstance(settings, Settling) else problem.settling
    if settling is None or not problem.count or any(shape.is_open for shape in problem.shapes):
        return None
    up, container = -(gravity_vector(problem) if gravity is None else gravity), problem.container
    fraction = settling.solid_fraction or usual_solid_fraction(problem, settling.friction)
    points = points_inside(container, stream(problem.seed, "height"))
    room = -np.asarray(container.signed_distance(points))
    floor, top = container_levels(container, up)
    level = linear.matmul(points, up) - floor
    filled = np.sort(level[room > AT_WALLS * mean_diameter(problem)])

    def height(volume: float) -> float:
        """Return the height above the floor below which grains of a volume come to rest."""
        share = volume / (fraction * container.volume) * len(points)
        return float(filled[int(share)]) if share < len(filled) else top - floor

    volume = float(problem.volumes.sum())
    depth = min(height(volume) + AT_SURFACE, top - floor)
    surface = height(HELD * min(volume, fraction * container.volume * len(filled) / len(points)))
    if (asked := getattr(settings, "height", None)) is not None and problem.length(asked) < depth:
        depth, surface = problem.length(asked), HELD * problem.length(asked)
    bulk = float(((room >= INSET) & (level <= surface)).mean()) * container.volume * fraction
    return ExpectedBed(depth, round(bulk / (volume / problem.count)))


def warn_of_height(task: Task, packing: Packing) -> None:
    """Warn where the surface of a bed is far from the height that was asked for.

    Where a count, or too low a container, decides how many grains there are, no height is expected.
    """
    asked, counted = getattr(task.problem.parameters, "height", None), task.asked["count"] is not None
    if asked is None or counted or packing.gravity is None or packing.stop_reason == "interrupted":
        return
    up: Floats = -np.asarray(packing.gravity)
    wanted = min(asked, highest_surface(task.problem, up) * task.problem.unit_length)
    surface = surface_level(packing)
    if abs(surface - wanted) > max(MET * wanted, 0.5 * packing.median_diameter):
        warn(
            f"the surface of the bed is at {surface:.4g} instead of {asked:g}: these grains rest denser or looser than "
            f"is known of their shape; give count={round(packing.count * wanted / surface)} in place of the height",
            PackingWarning,
        )


def surface_level(packing: Packing, first: int = 0, last: int | None = None) -> float:
    """Return the level, above the lowest point of the container, below which 95 percent of some grains have their tops;
    0 without grains or gravity.
    """
    if packing.gravity is None or packing.count == first:
        return 0.0
    up: Floats = -np.asarray(packing.gravity)
    tops = [top_of(packing, grain, up) for grain in range(first, packing.count if last is None else last)]
    return float(np.quantile(tops, BELOW)) - container_levels(packing.container, up)[0]


def top_of(packing: Packing, grain: int, up: Floats) -> float:
    """Return the highest level of a grain."""
    if packing.shapes[packing.shape_id[grain]].is_sphere:
        return float(linear.matmul(packing.position[grain], up) + packing.bounding_radii[grain])
    return float(linear.matmul(packing.world_vertices(grain), up).max())
