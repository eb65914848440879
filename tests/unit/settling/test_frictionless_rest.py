"""Frictionless beds: steps with curvature against their conditions, and rest against linear programs of HiGHS."""

import numpy as np
import pytest
from kit import slow
from scipy.optimize import linprog

import voxgran as vg
from tests.unit.settling.test_interior_point import DOWN, heap, normal_jacobian
from voxgran.settling.balance import LoadedContacts
from voxgran.settling.equilibrium import normalized_bed
from voxgran.settling.interior_point import frictionless_forces

SHAPES = {
    "spheres": lambda: vg.shapes.sphere(),
    "hulls": lambda: [vg.make_shape("convex_polyhedron", points=20, seed=seed) for seed in range(4)],
    "ellipsoids": lambda: vg.make_shape("ellipsoid", aspect=(1.25, 1.0, 0.8)),
    "clumps": lambda: vg.fit_clump(vg.make_shape("solid_union", seed=1), max_spheres=8).to_shape(),
}


def test_steps_with_curvature_meet_the_conditions_of_the_optimum():
    """The part of the forms that is not negative acts as springs do."""
    row, i, j, bodies = heap(7, round_grains=False)
    generator = np.random.default_rng(0)
    some = np.arange(0, len(i), 3)
    roots = generator.normal(size=(len(some), 12, 4))
    inner = (j[some] >= 0) & (j[some] < len(bodies) - 1)
    roots[~inner, 6:] = 0.0
    forms = roots @ roots.transpose(0, 2, 1)
    openness = 0.2 * generator.normal(size=len(i))
    force, found, _ = frictionless_forces(
        LoadedContacts(row, i, j, bodies, DOWN), openness=openness, skin=0.0, accuracy=1e-7, bend=(some, forms)
    )
    stiff = np.zeros((len(bodies), 6, len(bodies), 6))
    for k, form in zip(some, forms, strict=True):
        both = (i[k], j[k]) if 0 <= j[k] < len(bodies) - 1 else (i[k],)
        for a, one in enumerate(both):
            for b, other in enumerate(both):
                stiff[one, :, other] += form[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]
    matrix, inverse = normal_jacobian(row, i, j, bodies), np.repeat(bodies[:, 6:8], 3, axis=1).ravel()
    springs = stiff.reshape(len(inverse), -1) @ found.ravel()
    free = np.hstack([np.where(bodies[:, 6:7] > 0, DOWN, 0), np.zeros((len(bodies), 3))]).ravel()
    np.testing.assert_allclose(found.ravel(), free + inverse * (matrix.T @ force - springs), atol=1e-4)
    room = matrix @ found.ravel() + openness
    assert force.min() >= 0.0
    assert room.min() >= -1e-6
    assert np.abs(force * room).max() < 1e-5


def least_descent(packing, far=0.01):
    """Return how far the mean grain can sink, over `far`, if touching points do not approach: by HiGHS."""
    bed = normalized_bed(packing, DOWN)
    bed.find(1e-3, 0.0)
    m, n = bed.m, bed.count
    row, i, j = bed.rows.row[:m], bed.rows.i[:m], bed.rows.j[:m]
    gaps = np.zeros((m, n, 6))
    for k in range(m):
        normal = row[k, :3]
        gaps[k, i[k]] -= np.concatenate([normal, np.cross(row[k, 3:6], normal)])
        if j[k] >= 0:
            gaps[k, j[k]] += np.concatenate([normal, np.cross(row[k, 6:9], normal)])
    mass = 1.0 / bed.bodies[:n, 6]
    height = np.zeros((n, 6))
    height[:, 2] = mass / mass.sum()
    solved = linprog(height.ravel(), A_ub=-gaps.reshape(m, -1), b_ub=np.zeros(m), bounds=(-1.0, 1.0), method="highs")
    assert solved.status == 0
    return -solved.fun


@pytest.mark.parametrize("kind", [slow(kind) if kind in ("clumps", "ellipsoids") else kind for kind in SHAPES])
def test_beds_rest_and_no_small_motion_lets_them_sink(kind):
    box = vg.Box((3.2, 3.2, 10), periodic="xy")
    bed = vg.pack(SHAPES[kind](), box, "gravity", count=40, friction=0.0, seed=2)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] >= 0.95
    # grains that rest may rise or sink by motions of which no part is larger than 1
    assert least_descent(bed) < 0.03
    rough = vg.pack(SHAPES[kind](), box, "gravity", count=40, seed=2)
    assert least_descent(rough) > 0.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "count", "width"),
    [("hulls", 300, 6.0), ("ellipsoids", 300, 6.0), ("clumps", 150, 5.0), ("spheres", 3000, 13.0)],
)
def test_large_beds_rest(kind, count, width):
    box = vg.Box((width, width, 3.0 + 2.0 * count / width**2), periodic="xy")
    bed = vg.pack(SHAPES[kind](), box, "gravity", count=count, friction=0.0, seed=1)
    assert bed.verify().ok
    assert vg.equilibrium(bed, 0.0).attrs["share_at_rest"] >= 0.95


@pytest.mark.slow
def test_large_forces_do_not_close_gaps():
    # the grains at the floor carry so much that their contacts would overlap at the usual softness
    box = vg.Box((7, 7, 4000 / 49), periodic="xy")
    bed = vg.pack(SHAPES["spheres"](), box, "gravity", count=1000, friction=0.0, seed=1)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
