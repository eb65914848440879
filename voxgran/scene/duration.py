"""How long packing, settling and compressing take, expected by runs that were measured.

Each line of ``durations.csv`` is a step of a run: its scene, its CPU seconds, and the seconds of the yardstick on the
same machine. `tools/durations.py` measures them anew. The logarithm of the yardsticks that a step takes is linear in
`FEATURES`; the coefficients have normal priors, so that what was not measured widens the range (Bishop 2006, Pattern
Recognition and Machine Learning, section 3.3).
"""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.machine import yardstick
from voxgran.contacts.manifolds.convex_bodies import is_convex
from voxgran.packing.method import Cost
from voxgran.packing.missed import Task
from voxgran.packing.problem import Problem
from voxgran.scene.description import SceneDescription
from voxgran.settling.parameters import Compression, Settling
from voxgran.shapes.family import families
from voxgran.shapes.mesh import Mesh

#: what the duration of a step depends on, with the mean and the standard deviation of each coefficient before anything
#: is measured: of the logarithms of the grains, or of the seconds that the method itself expects, of the solid
#: fraction up to 1, of convex solids and others against spheres, of the logarithm of the faces of meshes over 100,
#: of two dimensions, of no friction, of a solid fraction that is sought, and of shaking
FEATURES: Mapping[str, tuple[float, float]] = {
    "constant": (-3.0, 5.0),
    "size": (1.0, 0.2),
    "solid_fraction": (0.0, 5.0),
    "convex": (1.0, 1.0),
    "other": (2.0, 1.5),
    "faces": (0.5, 0.5),
    "flat": (0.0, 1.0),
    "frictionless": (1.0, 1.0),
    "sought": (1.5, 1.0),
    "shaken": (1.0, 1.0),
}
#: standard deviation about the line that is expected, and the number of rows that this counts as
SCATTER, ROWS = 0.45, 4
#: quantile of the normal distribution for a range of 0.95, faces of a mesh of which none are known, and shapes of a
#: scene that are looked at
QUANTILE, FACES, LOOKED = 1.96, 100, 20
#: families of random shapes that are convex
CONVEX = ("convex_polyhedron", "voronoi_fragment")


@dataclass(frozen=True, slots=True)
class Step:
    """A step of a run and what its duration depends on, in the order of `FEATURES`."""

    name: str
    features: tuple[float, ...]


def grains_of(task: Task, cost: Cost) -> int:
    """Return how many grains a task is expected to have."""
    many = task.problem.apart.count
    return many if cost.grains is None or task.asked["count"] is not None else min(many, cost.grains)


def steps_of(scene: SceneDescription, task: Task, cost: Cost) -> list[Step]:
    """Return the steps of a scene, by its task and the cost of its method."""
    problem, grains = task.problem, grains_of(task, cost)
    if not grains:
        return []
    made = [entry.name for entry in scene.shapes if entry.source == "family" and families().get(entry.name).random]
    known, own, compression = _of_grains(problem, grains, made), problem.parameters, scene.compress
    if limits := [entry.faces for entry in scene.shapes if entry.faces is not None]:
        known["faces"] = min(known.get("faces", 0.0), math.log(max(limits) / FACES))
    moving = {kind.__name__: own for kind in (Settling, Compression) if isinstance(own, kind)}
    name = f"{task.method.name}, as it expects"
    expects = cost.seconds > 0.0 and fit_of(name) is not None
    first = known | ({"size": math.log(cost.seconds)} if expects else {})
    found = [(name if expects else task.method.name, first, next(iter(moving.values()), None))]
    found += [("settle", known, problem.settling)] * (problem.settling is not None)
    found += [("compress", known, compression)] * (compression is not None)
    return [
        Step(name, tuple(({**values, **_of_motion(how)}).get(f, 0.0) for f in FEATURES)) for name, values, how in found
    ]


def _of_grains(problem: Problem, grains: int, made: Sequence[str]) -> dict[str, float]:
    """Return the features of so many grains; made: families of random shapes, for which others stand."""
    share = float(problem.volumes[:grains].sum() / problem.container.volume)
    known: dict[str, float] = {"constant": 1.0, "size": math.log(grains), "solid_fraction": min(share, 1.0)}
    known["flat"], shapes = float(problem.dimension == 2), problem.shapes[:LOOKED]
    round_ones = [shape.is_sphere or is_convex(shape.geometry) for shape in shapes]
    if not all(round_ones) or any(name not in CONVEX for name in made):
        faces = [len(shape.faces) for shape in shapes if isinstance(shape.geometry, Mesh)]
        return known | {"other": 1.0, "faces": math.log(max(faces, default=FACES) / FACES)}
    return known | {"convex": float(not all(shape.is_sphere for shape in shapes))}


def _of_motion(how: Settling | Compression | None) -> dict[str, float]:
    """Return the features of grains that come to rest."""
    if how is None:
        return {}
    sought = how.solid_fraction is not None or getattr(how, "height", None) is not None
    return {
        "frictionless": float(not sought and how.friction == 0.0),
        "sought": float(sought),
        "shaken": float(getattr(how, "shaking", None) is not None),
    }


def expected_seconds(steps: Sequence[Step]) -> tuple[float, float, float]:
    """Return the CPU seconds that steps are expected to take on this machine, and their 0.95 range; 0 three times where
    a method was not measured.
    """
    fits = [fit_of(step.name) for step in steps]
    if not steps or any(fit is None for fit in fits):
        return 0.0, 0.0, 0.0
    told = [fit.expected(np.array(step.features)) for step, fit in zip(steps, fits, strict=True) if fit]
    middle = [yardstick() * math.exp(mean) for mean, _ in told]
    whole = math.fsum(middle)
    # of a sum of lognormal times
    spread = math.sqrt(
        math.fsum((one / whole) ** 2 * variance for one, (_, variance) in zip(middle, told, strict=True))
    )
    factor = math.exp(QUANTILE * spread)
    return whole, whole / factor, whole * factor


@dataclass(frozen=True, slots=True)
class Fit:
    """Coefficients of a step: their mean (k,), covariance (k, k), and the variance about the line."""

    mean: Floats
    covariance: Floats
    scatter: float

    @classmethod
    def of(cls, features: Floats, logarithms: Floats) -> "Fit":
        """Return the fit of rows (n, k) of features and the logarithms (n,) of their yardsticks."""
        first = cls._with(features, logarithms, SCATTER**2)
        # each row is expected by the others
        share = (features * (features[:, None] * first.covariance).sum(axis=2)).sum(axis=1) / SCATTER**2
        residuals = (logarithms - (features * first.mean).sum(axis=1)) / (1.0 - share)
        scatter = (ROWS * SCATTER**2 + float((residuals**2).sum())) / (ROWS + len(features))
        return cls._with(features, logarithms, scatter)

    @classmethod
    def _with(cls, features: Floats, logarithms: Floats, scatter: float) -> "Fit":
        """Return the fit with a variance about the line, row by row."""
        mean, deviation = np.array(list(FEATURES.values())).T
        covariance = np.diag(deviation**2)
        for row, value in zip(features, logarithms, strict=True):
            reach = (covariance * row).sum(axis=1)
            gain = reach / (scatter + float((row * reach).sum()))
            mean = mean + gain * (value - float((row * mean).sum()))
            covariance = covariance - gain[:, None] * reach
        return cls(mean, covariance, scatter)

    def expected(self, features: Floats) -> tuple[float, float]:
        """Return the mean and the variance of the logarithm of a step with features (k,)."""
        spread = float((features * (self.covariance * features).sum(axis=1)).sum())
        return float((features * self.mean).sum()), self.scatter + spread


def measured() -> Iterator[tuple[str, Floats, float, str]]:
    """Yield the step, features (k,), logarithm of the yardsticks and the scene of each row that was measured."""
    with Path(__file__).with_name("durations.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            features = np.array([1.0, *(float(row[name] or 0) for name in list(FEATURES)[1:])])
            yield row["step"], features, math.log(float(row["seconds"]) / float(row["yardstick"])), row["scene"]


@cache
def fit_of(step: str) -> Fit | None:
    """Return the fit of a step; None where it was not measured."""
    rows: list[Any] = [(features, value) for name, features, value, _ in measured() if name == step]
    return Fit.of(np.array([one for one, _ in rows]), np.array([value for _, value in rows])) if rows else None
