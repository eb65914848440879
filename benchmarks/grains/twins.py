"""Twins: grains that are drawn from a learned distribution, against others that were not learned from.

The error is the energy distance of sphericity, elongation, flatness, convexity and roundness of drawn grains from the
test grains; beside it that of the learned grains themselves, below which none can be expected. One sample scatters:
the numbers are means over samples. Seconds are CPU seconds, without descriptors.
"""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.shapes.boolean import united
from voxgran.shapes.family import make_shape, make_shapes, seeds_of_shapes
from voxgran.shapes.generating.radii import radii_of
from voxgran.shapes.generating.spherical_fields import coefficients_of, field_values, sphere_quadrature
from voxgran.shapes.images.labels import load_labels
from voxgran.shapes.learning.learn import learn_shapes
from voxgran.shapes.learning.likeness import (
    comparable,
    descriptors,
    energy_distance,
    nearest_neighbour_test,
    signatures,
    spread_of,
)
from voxgran.shapes.learning.report import novelty
from voxgran.shapes.learning.sample import checked_sample
from voxgran.shapes.learning.warp import frame_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sphere
from voxgran.voxels.occupy import voxelize

#: samples, grains that are learned from, drawn and tested on, and the numbers that are learned from of one family
SAMPLES, LEARNED, DRAWN, TESTED, NUMBERS = 2, 100, 200, 150, (20, 40, 80, 160)
#: grains that are learned from and drawn to take the time
MANY = (500, 1000)
#: seed of the test grains; the samples have the seeds that follow
SEED = 8000
#: cases of few parameters of which harmonics are compared, degrees of these, and share that the components explain
SMOOTH, DEGREES, EXPLAINED = ("mollon_zhao", "ellipsoids", "spherical_harmonics"), 16, 0.95
#: tolerance of the surfaces of tori and rods, by which strained meshes have no sharp edges either
FINE = 0.005
#: voxels of a diameter of the images, and standard deviations of their noise and of the filter
VOXELS, NOISE, FILTER = 16, 0.3, 1.0


@dataclass(frozen=True, slots=True)
class Row:
    """What was measured of a case."""

    case: str
    grains: int
    strength: float
    energy_distance: float | None
    sample_error: float | None
    ratio: float | None
    novelty: float | None
    same_neighbour: float | None
    learn_seconds: float
    draw_seconds: float


def of_family(name: str, **parameters: object) -> Callable[[int, int], list[Shape]]:
    """Return the function that makes a number of grains of a family with a seed."""
    return lambda count, seed: make_shapes(name, count=count, seed=seed, **parameters)


def ellipsoids(count: int, seed: int) -> list[Shape]:
    """Return ellipsoids of random ratios, as meshes."""
    draw = stream(seed, "ellipsoids")
    ratios = np.column_stack([np.ones(count), draw.uniform(0.6, 0.95, count), draw.uniform(0.3, 0.6, count)])
    directions, faces, _ = sphere(3)
    return [Shape.of(Mesh(directions * row, faces), name="ellipsoid") for row in ratios]


def two_families(count: int, seed: int) -> list[Shape]:
    """Return polyhedra and rounded sand, half of each."""
    sand = make_shapes("mollon_zhao", count=count - count // 2, seed=seed + 1000, d_2=0.2, subdivisions=3)
    return [*make_shapes("convex_polyhedron", count=count // 2, seed=seed, aspect=(1.3, 1, 0.8)), *sand]


def rings_with_rods(count: int, seed: int) -> list[Shape]:
    """Return unions of a torus and a rod, which are not star-shaped and have a hole."""
    made, turns = [], random_rotations(stream(seed, "rods"), count)
    for k, own in enumerate(seeds_of_shapes(seed, count)):
        draw = stream(own, "rings with rods")
        ring = make_shape("torus", aspect=draw.uniform(0.25, 0.45), tolerance=FINE)
        rod = make_shape("spherocylinder", aspect=draw.uniform(3.0, 6.0), diameter=0.8)
        rod = rod.rotated(turns[k])
        place = np.array([0.75 * ring.bounds[1, 0], 0.0, 0.0])
        parts = united([(ring.vertices, ring.faces), (rod.vertices + place, rod.faces)])
        made.append(Shape.of(Mesh(*parts), name="ring with rod"))
    return made


def labels(grains: list[Shape], seed: int) -> list[Shape]:
    """Return grains as the labels of filtered images with noise."""
    made, noise, images = [], stream(seed, "noise"), load("scipy.ndimage")
    for shape in grains:
        mask = np.pad(voxelize(shape, voxel_size=shape.diameter / VOXELS).mask, 4).astype(np.float64)
        grey = images.gaussian_filter(mask + noise.normal(0.0, NOISE, mask.shape), FILTER)
        bodies, number = images.label(grey > 0.5)
        largest = 1 + int(np.argmax(images.sum_labels(mask >= 0, bodies, range(1, number + 1))))
        made += load_labels((bodies == largest).astype(np.int64), voxel_size=1 / VOXELS)
    return made


CASES: dict[str, Callable[[int, int], list[Shape]]] = {
    "convex_polyhedron": of_family("convex_polyhedron", points=(14, 26), aspect=(1.3, 1.0, 0.8)),
    "solid_union": of_family("solid_union"),
    "voronoi_fragment": of_family("voronoi_fragment"),
    "mollon_zhao": of_family("mollon_zhao", subdivisions=3),
    "ellipsoids": ellipsoids,
    "two_families": two_families,
    "spherical_harmonics": of_family("spherical_harmonics", degree=6, subdivisions=3, aspect=(1.2, 1.0, 0.8)),
    "rings_with_rods": rings_with_rods,
    "labels_of_rings_with_rods": lambda count, seed: labels(rings_with_rods(count, seed), seed),
    "labels_of_solid_unions": lambda count, seed: labels(make_shapes("solid_union", count=count, seed=seed), seed),
}
#: cases of which several numbers of grains, and many, are learned
GROWING, LARGE = "voronoi_fragment", "solid_union"


def run(folder: Path) -> tuple[Path, ...]:
    """Write twins.csv and twins.svg into a folder and return both."""
    rows = [row for case in CASES for row in rows_of(case, LEARNED, *(NUMBERS if case == GROWING else ()))]
    rows.append(timed_row(LARGE))
    return written(rows, folder)


def written(rows: list[Row], folder: Path) -> tuple[Path, ...]:
    """Write rows and their figure."""
    head = "case,grains,strength:.3g,energy_distance:.3f,sample_error:.3f,ratio:.2f,novelty:.2f,same_neighbour:.2f"
    table = write_rows(folder / "twins.csv", f"{head},learn_seconds:.2f,draw_seconds:.2f", map(astuple, rows))
    growing = sorted((row for row in rows if row.case == GROWING and row.ratio), key=lambda row: row.grains)
    with panels_of(folder / "twins.svg", 2, width=10.0, height=4.0) as panels:
        panels[0].plot([0, 0.08], [0, 0.12], ":", color="k", label="1.5 times that of the sample")
        for row in rows:
            if row.grains == LEARNED and not row.case.endswith(" by harmonics"):
                panels[0].plot(row.sample_error, row.energy_distance, "o", label=row.case.replace("_", " "))
        panels[0].set(xlabel="energy distance of the sample", ylabel="energy distance of drawn grains")
        for name in ("energy_distance", "sample_error"):
            xs, ys = [row.grains for row in growing], [getattr(row, name) for row in growing]
            panels[1].plot(xs, ys, "o-", label=name.replace("_", " "))
        panels[1].set(xscale="log", xlabel="grains that are learned from", title=GROWING.replace("_", " "))
        panels[1].set_ylim(bottom=0.0)
        panels[1].set_xticks(xs, [str(count) for count in xs], minor=False)
        panels[1].minorticks_off()
    return table, folder / "twins.svg"


class Known(NamedTuple):
    """Grains, and their descriptors and signatures."""

    shapes: list[Shape]
    rows: Floats
    marks: Floats


def known(shapes: list[Shape]) -> Known:
    """Return grains with what is compared of them."""
    return Known(shapes, descriptors(shapes), signatures(shapes))


def rows_of(case: str, *numbers: int) -> list[Row]:
    """Return the rows of a case with numbers of grains in the samples, and that of harmonics where it is compared."""

    def grains(count: int, seed: int) -> Known:
        return known(checked_sample(CASES[case](count, seed), None, None).shapes)

    unseen, found = grains(TESTED, SEED), []
    for count in numbers:
        samples = [grains(count, SEED + 1 + k) for k in range(SAMPLES)]
        plans: list[tuple[str, Callable[..., Any]]] = [(case, learn_shapes)]
        if case in SMOOTH and count == LEARNED:
            plans.append((f"{case} by harmonics", Harmonics.of))
        for name, learn in plans:
            each = np.mean([measured(learn, sample, unseen) for sample in samples], axis=0)
            strength, error, own, *others = each.tolist()
            found.append(Row(name, count, strength, error, own, error / own, *others))
    return found


def measured(learn: Callable[..., Any], given: Known, unseen: Known) -> tuple[float, ...]:
    """Return strength, errors, novelty, nearest neighbours and seconds of one sample."""
    model, learning = timed(learn, given.shapes)
    made, drawing = timed(model.sample, DRAWN)
    drawn = known(made)
    (rows, own, other), _ = comparable(drawn.rows, given.rows, unseen.rows)
    spread, fewer = spread_of(other), min(DRAWN, TESTED)
    share, _ = nearest_neighbour_test(drawn.marks[:fewer], unseen.marks[:fewer], stream(SEED, "neighbours"))
    errors = (energy_distance(other, rows, spread), energy_distance(own, other, spread))
    return (model.strength, *errors, novelty(drawn.marks, given.marks, unseen.marks), share, learning, drawing)


@dataclass(frozen=True)
class Harmonics:
    """The model that is not offered: spherical harmonics of the radius, principal components and a Gaussian copula."""

    mean: Floats
    components: Floats  # (c, 2 degree^2)
    scores: Floats  # (n, c)
    strength: float = math.nan

    @classmethod
    def of(cls, shapes: list[Shape]) -> "Harmonics":
        """Learn from grains in the frames of their principal axes."""
        directions, weights = sphere_quadrature(2 * DEGREES)
        rows = []
        for shape in shapes:
            mesh = Mesh(shape.vertices, shape.faces)
            axes = frame_of(mesh)[3]
            axes[:, 2] *= np.sign(np.linalg.det(axes))
            body = Shape.of(Mesh((mesh.vertices - mesh.centroid) @ axes, mesh.corners), name="body")
            fields = coefficients_of(DEGREES, directions, weights, np.log(radii_of(body, directions)[0]))
            rows.append(np.concatenate([field.ravel() for field in fields]))
        mean = np.mean(rows, axis=0)
        _, sizes, components = np.linalg.svd(rows - mean, full_matrices=False)
        kept = 1 + int(np.searchsorted(np.cumsum(sizes**2) / (sizes**2).sum(), EXPLAINED))
        return cls(mean, components[:kept], (rows - mean) @ components[:kept].T)

    def sample(self, count: int) -> list[Shape]:
        """Draw grains."""
        normal, number = load("scipy.stats").norm, len(self.scores)
        ranks = (np.argsort(np.argsort(self.scores, axis=0), axis=0) + 0.5) / number
        related = np.atleast_2d(np.corrcoef(normal.ppf(ranks).T))
        drawn = stream(SEED, "copula").multivariate_normal(np.zeros(len(related)), related, count)
        shares = normal.cdf(drawn).T
        scores = np.array([np.quantile(own, share) for own, share in zip(self.scores.T, shares, strict=True)]).T
        directions, faces, _ = sphere(3)
        rows = (self.mean + scores @ self.components).reshape(count, 2, DEGREES, DEGREES)
        return [
            Shape.of(
                Mesh(np.exp(field_values(row[0], row[1], directions))[:, None] * directions, faces), name="harmonics"
            )
            for row in rows
        ]


def timed_row(case: str) -> Row:
    """Return the row with the seconds of many grains."""
    learned, drawn = MANY
    model, learning = timed(learn_shapes, CASES[case](learned, SEED + 1))
    _, drawing = timed(model.sample, drawn)
    return Row(case, learned, model.strength, None, None, None, None, None, learning, drawing)
