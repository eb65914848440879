"""Twins in closed loops: a specimen becomes an image, labels and a twin, which is compared with the specimen.

Specimens are graded grains, compressed with friction in a periodic cell. Their images are cut on all sides, segmented
as scans are, and the twins are made of the labels alone. The scatter is that of specimen and twin together: what two
parts of one material would differ by. The coordination number and the peak of g(r) of one packing scatter by as much
as the difference that is sought, so that their means over several specimens and twins stand beside them. Seconds are
CPU seconds of the twin, with the search of its friction.
"""

import warnings
from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.errors import PackingWarning
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.io.image import to_image
from voxgran.lattice.segment import segment
from voxgran.measures.registered.rdf import radial_distribution
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.packing.transform.from_labels import packing_of_labels
from voxgran.scene.twins.compared import STEP
from voxgran.scene.twins.twin import Twin, drawn, twin
from voxgran.shapes.family import make_shape, make_shapes
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.simplify import simplify
from voxgran.shapes.sizes import lognormal

#: grains of a specimen and of its twin, different shapes of the specimen, and most triangles of one
GRAINS, SHAPES, FACES = 500, 40, 300
#: specimens and twins whose coordination numbers and peaks of g(r) are averaged, and different shapes of a twin
SEEDS, FORMS = 4, 100
#: edge of the voxels of an image in median diameters, voxels that are cut from each side, and friction of specimens
VOXEL, CUT, FRICTION = 0.06, 6, 0.2
#: measures of the table, with the largest difference that is sought, and whether it is one of the value itself
LIMITS: dict[str, tuple[float | None, bool]] = {
    "solid_fraction": (0.005, False),
    "coordination_number": (0.3, False),
    "mean_coordination_number": (0.3, False),
    "D50": (0.02, True),
    "radial_peak": (None, True),
    "mean_radial_peak": (0.05, True),
    "tortuosity": (0.05, True),
    **dict.fromkeys(("local_solid_fraction", "sphericity", "flatness", "convexity"), (None, False)),
    **dict.fromkeys(("pore_chord", "wetted_surface", "contact_area"), (None, True)),
}


@dataclass(frozen=True, slots=True)
class Row:
    """A measure of a specimen and of its twin."""

    case: str
    measure: str
    specimen: float
    twin: float
    difference: float  # over the value of the specimen where the limit is
    ratio: float  # difference over the scatter of both
    limit: float | None
    whole_grains: int  # of the labels, those that the border does not cut
    twin_seconds: float


def ellipsoids() -> list[Shape]:
    """Return ellipsoids of random ratios."""
    draw = stream(1, "twin loops")
    ratios = np.column_stack([np.ones(SHAPES), draw.uniform(0.7, 1.0, SHAPES), draw.uniform(0.5, 0.7, SHAPES)])
    return [make_shape("ellipsoid", semi_axes=tuple(row)) for row in ratios.tolist()]


def polyhedra() -> list[Shape]:
    """Return convex polyhedra."""
    return make_shapes("convex_polyhedron", count=SHAPES, seed=1)


def rocks() -> list[Shape]:
    """Return unions of solids, which are not convex."""
    return [simplify(shape, faces=FACES).shape for shape in make_shapes("solid_union", count=SHAPES, seed=1)]


CASES: dict[str, Callable[[], list[Shape]]] = {"ellipsoids": ellipsoids, "polyhedra": polyhedra, "rocks": rocks}


def run(folder: Path) -> tuple[Path, ...]:
    """Write twin_loops.csv and twin_loops.svg into a folder and return both."""
    rows = [row for case in CASES for row in rows_of(case)]
    head = "case,measure,specimen:.4g,twin:.4g,difference:.4f,ratio:.1f,limit,whole_grains,twin_seconds:.0f"
    table = write_rows(folder / "twin_loops.csv", head, map(astuple, rows))
    limited = [name.replace("_", " ") for name, (limit, _) in LIMITS.items() if limit is not None]
    with panels_of(folder / "twin_loops.svg", 1, width=7.0) as panels:
        for case in CASES:
            share = [row.difference / row.limit for row in rows if row.case == case and row.limit is not None]
            panels[0].plot(share, limited, "o", label=case)
        for edge in (-1, 1):
            panels[0].axvline(edge, color="k", linestyle=":")
        # room for the legend beyond the limit
        panels[0].set(xlabel="twin less specimen, over the limit", xlim=(-1.1, 1.7))
    return table, folder / "twin_loops.svg"


def rows_of(case: str) -> list[Row]:
    """Return the rows of a case."""
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        specimen, scan = specimen_and_scan(case)
        made: Twin
        made, seconds = timed(twin, scan, count=GRAINS, seed=5)
        found, means = made.compared_with(specimen), scattered_of(case, specimen, made)
    rows = []
    for name, (limit, relative) in LIMITS.items():
        if name in means:
            true, other = means[name].mean(axis=1)
            ratio = (other - true) / np.hypot(*means[name].std(axis=1, ddof=1)) * np.sqrt(SEEDS)
        else:
            one = found.sel(measure=name)
            true, other, ratio = (float(one[of]) for of in ("sample", "twin", "ratio"))
        difference = other / true - 1.0 if relative else other - true
        rows.append(Row(case, name, true, other, difference, ratio, limit, len(made.sample.shapes), seconds))
    return rows


def scattered_of(case: str, specimen: Packing, made: Twin) -> dict[str, Floats]:
    """Return the values, (2, SEEDS), of what scatters most: of specimens and of twins with other seeds and the friction
    that is known of the first.
    """
    friction = made.packing.provenance["compression"]["sought"]["friction"]
    packings = [[specimen], [made.packing]]
    for seed in range(1, SEEDS):
        packings[0].append(specimen_of(case, 3 + seed))
        shapes, shape_id, sizes = drawn(made.sample, GRAINS, made.model, FORMS, 5 + seed)
        asked = {"grains": {"shape": shape_id, "diameter": sizes}, "friction": friction, "seed": 5 + seed}
        packings[1].append(pack(shapes, made.packing.container, "compress", **asked))
    # as in the comparison, contacts of both are counted within the larger gap
    gap = max(one.contact_gap for group in packings for one in group)
    return {
        "mean_coordination_number": np.array(
            [[2 * one.contacts(gap).count / one.count for one in p] for p in packings]
        ),
        "mean_radial_peak": np.array([[radial_distribution(one, step=STEP).g.max() for one in p] for p in packings]),
    }


def specimen_of(case: str, seed: int) -> Packing:
    """Return a specimen of a case."""
    edge = 1.35 * np.cbrt(GRAINS)
    box, sizes = Box((edge, edge, edge), "xyz"), lognormal(median=1.0, sigma=0.2)
    return pack(CASES[case](), box, "compress", count=GRAINS, sizes=sizes, friction=FRICTION, seed=seed)


def specimen_and_scan(case: str) -> tuple[Packing, Packing]:
    """Return a specimen, and the labels of its cut image."""
    specimen = specimen_of(case, 3)
    image = to_image(specimen, VOXEL, labels=False)[CUT:-CUT, CUT:-CUT, CUT:-CUT]
    labels = segment(image.astype(float), threshold=0.5, voxel_size=VOXEL).labels
    return specimen, packing_of_labels(np.asarray(labels), voxel_size=VOXEL, gravity="none")
