"""Second derivatives of gaps: against differences of the gaps that are found; first ones at corners of faces."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, GAP, NORMAL
from voxgran.settling.equilibrium import normalized_bed

SHAPES = {
    "ellipsoids": vg.make_shape("ellipsoid", aspect=(1.25, 1.0, 0.8)),
    "clumps": vg.fit_clump(vg.make_shape("solid_union", seed=1), max_spheres=8).to_shape(),
    "hulls": vg.make_shape("convex_polyhedron", points=20, seed=1),
    "spheres": vg.shapes.sphere(),
}


def pair(one, other, seed, apart=1e-3):
    """Return two grains with random orientations, in a bed without walls near, `apart` from each other."""
    generator = np.random.default_rng(seed)
    turns = generator.normal(size=(2, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    way = generator.normal(size=3)
    way /= np.linalg.norm(way)
    far = one.bounding_radius + other.bounding_radius
    for _ in range(40):
        packing = vg.Packing.of(
            [one, other],
            vg.Box((20, 20, 20)),
            shape_id=[0, 1],
            position=[(10, 10, 10), 10 + far * way],
            orientation=turns,
        )
        bed = normalized_bed(packing, np.array([0.0, 0.0, -1.0]))
        gap = gap_of(bed)
        if abs(gap - apart) < 1e-6:
            break
        far -= (gap - apart) * packing.median_diameter
    return bed


def gap_of(bed):
    """Return the least gap of the contacts of a bed."""
    bed.find(0.4, 0.0)
    return float(bed.gap[bed.rows.j[: bed.m] >= 0].min(initial=0.4))


def moved(bed, motion):
    """Return the gap after motions (12,) of both grains; the grains return to their places."""
    position, orientation = bed.grains.position.copy(), bed.orientation.copy()
    bed.move(np.vstack([motion.reshape(2, 6), np.zeros((1, 6))]), 1.0)
    gap = gap_of(bed)
    bed.put(position, orientation, np.inf)
    return gap


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "kinds", ["ellipsoids ellipsoids", "clumps clumps", "hulls hulls", "spheres ellipsoids", "spheres hulls"]
)
def test_second_derivatives_are_those_of_differences(kinds, seed):
    one, other = (SHAPES[kind] for kind in kinds.split())
    bed = pair(one, other, seed)
    motion = np.random.default_rng(100 + seed).normal(size=12)
    step = 1e-5 if "hulls" in kinds else 1e-4
    gaps = [moved(bed, part * step * motion) for part in (-1.0, 0.0, 1.0)]
    inner = bed.rows.j[: bed.m] >= 0
    some = np.array([int(np.argmin(np.where(inner, bed.gap, np.inf)))])
    found = motion @ bed.finders.curvature(bed.grains, bed.rows, some)[0] @ motion
    expected = (gaps[0] - 2.0 * gaps[1] + gaps[2]) / step**2
    # corners of hulls that meet have gaps whose directions turn fast
    assert found == pytest.approx(expected, rel=0.03, abs=0.03)


def test_a_bed_of_spheres_has_none():
    bed = normalized_bed(
        vg.Packing.of(SHAPES["spheres"], vg.Box((4, 4, 4)), position=[(1, 1, 1), (2, 1, 1)]), np.array([0.0, 0.0, -1.0])
    )
    bed.find(0.1, 0.0)
    assert not bed.finders.curvature(bed.grains, bed.rows, np.arange(bed.m)).any()


def test_gaps_change_as_the_rows_say():
    """Of corners of faces that are near each other the one of the least gap is a contact: no overlap is missed."""
    worst = []
    for seed in range(30):
        bed = facing(seed)
        gap_of(bed)
        inner = bed.rows.j[: bed.m] >= 0
        row = bed.rows.row[: bed.m][inner]
        motion = 2e-3 * np.random.default_rng(seed).normal(size=12)
        opening = [
            sign * (motion[at : at + 3] + np.cross(motion[at + 3 : at + 6], row[:, arm : arm + 3]))
            for sign, at, arm in ((-1.0, 0, ARM_I), (1.0, 6, ARM_J))
        ]
        said = float((row[:, GAP] + (sum(opening) * row[:, NORMAL : NORMAL + 3]).sum(axis=1)).min())
        worst.append(said - moved(bed, motion))
    assert np.max(worst) < FACES_MISSED
    assert np.median(np.abs(worst)) < 1e-4


#: of the same motions with the corner that is farthest from the others: 2e-3
FACES_MISSED = 5e-4


def facing(seed):
    """Return two hulls of which faces lie nearly on each other."""
    generator = np.random.default_rng(seed)
    hull = vg.make_shape("convex_polyhedron", points=20, seed=seed)
    corners = hull.vertices[hull.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    largest = np.argsort(sizes)[-2:]
    tilt = 0.01 * generator.normal(size=3)
    ways = [np.array([0.0, 0.0, 1.0]), np.array([*tilt[:2], -1.0])]
    turns = [
        rotation_to(normals[k] / sizes[k], way / np.linalg.norm(way)) for k, way in zip(largest, ways, strict=True)
    ]
    far = 2.0 * hull.bounding_radius
    for _ in range(30):
        packing = vg.Packing.of(
            hull, vg.Box((20, 20, 20)), position=[(10, 10, 10), (10 + tilt[2], 10, 10 + far)], orientation=turns
        )
        bed = normalized_bed(packing, np.array([0.0, 0.0, -1.0]))
        gap = gap_of(bed)
        if abs(gap - 1e-3) < 1e-6:
            break
        far -= (gap - 1e-3) * packing.median_diameter
    return bed


def rotation_to(one, other):
    """Return the quaternion of the rotation that turns one unit vector to another."""
    made = np.array([1.0 + one @ other, *np.cross(one, other)])
    return made / np.linalg.norm(made)
