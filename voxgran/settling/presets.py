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
    reuse: float = 0.0  # motion of a pair up to which its contacts are not found again


#: of spheres and disks, and of convex grains and polygons
FRICTIONAL = (
    SolverPreset(KEPT, 0.1, 0.1, first=0.3, last=0.1, steps=150),
    SolverPreset(KEPT, 0.1, 0.1, first=0.2, last=0.1, steps=150),
)
#: of the same without friction: of spheres and of convex grains, solved to the end with steps that become longer, of
#: which steps of spheres move no two grains into each other; and where that would take too long
FRICTIONLESS = (
    SolverPreset(2e-4, 0.1, 0.1, first=1.0, last=2.0, steps=120, examined=4),
    SolverPreset(KEPT, 0.1, 0.1, first=0.5, last=1.0, steps=100, examined=5),
    SolverPreset(KEPT, 0.1, 0.03, first=0.2, last=0.05, steps=60),
)
#: of meshes that are not convex: by grids of distances, the same where it is known by how much these are wrong, then by
#: triangles
GRIDS = SolverPreset(4e-3, 0.024, 0.02, first=0.15, last=0.1, steps=50)
ROOMED = SolverPreset(KEPT, 0.024, 5e-3, first=0.1, last=0.1, steps=8)
TRIANGLES = SolverPreset(KEPT, 5e-3, 2e-3, first=0.1, last=0.05, steps=160, examined=10, reuse=1e-3)
