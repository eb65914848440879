"""Solver presets of quasi-static steps, by the kind of the grains and the friction."""

from dataclasses import dataclass

#: distance that surfaces keep
KEPT = 5e-4


@dataclass(frozen=True, slots=True)
class SolverPreset:
    """Numbers by which quasi-static steps are made; lengths are in median diameters."""

    kept: float  # distance that surfaces keep
    margin: float  # gap up to which contacts are found
    most: float  # farthest that a grain moves in a step
    first: float  # length of the first step
    last: float  # of the last ones
    steps: int  # largest number of steps
    examined: int = 0  # steps between two examinations; 0: when hardly any grain moves
    late: int = 0  # steps from which on steps become shorter
    reuse: float = 0.0  # motion of a pair up to which its contacts are not found again


#: of spheres, disks and polygons, whose steps become shorter only where a bed has not come to rest for long, and of
#: convex grains, which take more of the long steps
FRICTIONAL = (
    SolverPreset(KEPT, 0.1, 0.1, first=0.3, last=0.1, steps=150, late=75),
    SolverPreset(KEPT, 0.1, 0.1, first=0.2, last=0.1, steps=150),
)
#: of the same without friction, on soft contacts, whose lengths are compressions; and of polygons without friction
SOFT = (
    SolverPreset(KEPT, 0.1, 0.1, first=3e-4, last=0.0, steps=200, examined=4),
    SolverPreset(KEPT, 0.1, 0.1, first=2e-4, last=0.0, steps=150, examined=1),
)
FRICTIONLESS = SolverPreset(KEPT, 0.1, 0.03, first=0.2, last=0.05, steps=60)
#: of meshes that are not convex: by grids of distances, the same where it is known by how much these are wrong, then by
#: triangles
GRIDS = SolverPreset(4e-3, 0.024, 0.02, first=0.15, last=0.1, steps=50)
ROOMED = SolverPreset(KEPT, 0.024, 5e-3, first=0.1, last=0.1, steps=8)
TRIANGLES = SolverPreset(KEPT, 5e-3, 2e-3, first=0.1, last=0.05, steps=160, examined=10, reuse=1e-3)
