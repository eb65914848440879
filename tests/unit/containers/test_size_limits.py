"""Grains are refused only where they cannot fit however they are turned."""

import dataclasses
import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import FileFormatError, GrainTooLargeError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.containers.size_limits import can_fit
from voxgran.geometry.rotation import random_rotations, rotation_matrices

ROD = {"radius": 0.1, "height": 5.0}
CUBE, SLAB, TUBE = vg.Box((4, 4, 4)), vg.Box((9, 9, 0.9), "xy"), vg.Cylinder(1.5, 4.0)


def fits(shape, container):
    return bool(can_fit([shape], container, np.zeros(1, dtype=np.int64), np.array([shape.diameter]))[0])


def box(*lengths):
    return vg.make_shape("box", lengths=lengths)


@pytest.mark.parametrize(
    ("shape", "container", "expected"),
    [
        (vg.make_shape("cylinder", **ROD), CUBE, True),
        (vg.make_shape("cylinder", radius=0.1, height=7.0), CUBE, False),
        (box(0.1, 0.1, math.sqrt(48) - 0.1), CUBE, True),
        (vg.make_shape("sphere", diameter=4.0), CUBE, True),
        (vg.make_shape("sphere", diameter=4.001), CUBE, False),
        (box(1.0, 4.0, 4.0), SLAB, False),
        (box(0.9, 4.0, 9.5), SLAB, True),
        (vg.make_shape("ellipsoid", semi_axes=(0.46, 3.0, 5.0)), SLAB, False),
        (vg.make_shape("cone", radius=3.0, height=0.8), vg.Box((4, 4, 0.5)), False),
        (vg.make_shape("spherocylinder", radius=0.25, height=4.4), vg.Box((4, 4, 0.5)), True),
        (vg.make_shape("spherocylinder", radius=0.26, height=2.0), vg.Box((4, 4, 0.5)), False),
        (vg.make_shape("platonic", solid="cube"), vg.Box((9, 9, 0.8)), False),
        (vg.make_shape("platonic", solid="octahedron", diameter=9.0), vg.Box((9, 9, 8), "z"), True),
        (vg.make_shape("cylinder", radius=0.01, height=4.99), TUBE, True),
        (vg.make_shape("cylinder", radius=0.01, height=5.01), TUBE, False),
        (vg.make_shape("cylinder", radius=0.01, height=3.01), vg.Sphere(1.5), False),
        (vg.make_shape("cylinder", radius=0.1, height=50.0), vg.Box((4, 4, 4), "xyz"), True),
        (vg.make_shape("cylinder", radius=0.2, height=600.0), vg.Box((4, 4, 4), "xyz"), False),
        (vg.make_shape("sphere", diameter=4.001), vg.Box((4, 9, 9), "x"), False),
        (vg.make_shape("sheet", lengths=(5.0, 0.2)), CUBE, True),
        (vg.make_shape("sheet", lengths=(7.0, 0.2)), CUBE, False),
        (vg.make_shape("polygon", vertices=[(0, 0), (5, 0), (5, 0.1), (0, 0.1)]), vg.Rectangle((4, 4)), True),
        (vg.make_shape("polygon", vertices=[(0, 0), (5, 0), (5, 1), (0, 1)]), vg.Rectangle((9, 0.9)), False),
    ],
)
def test_what_fits_somehow(shape, container, expected):
    assert fits(shape, container) is expected


@pytest.mark.parametrize("seed", range(20))
def test_what_lies_in_a_box_is_never_refused(seed):
    shape = vg.make_shape("convex_polyhedron", points=12, aspect=(1, 2, 6), seed=seed)
    turn = rotation_matrices(random_rotations(stream(seed, "turn"), 1))[0]
    assert fits(shape, vg.Box(np.ptp(shape.vertices @ turn.T, axis=0)))


@pytest.mark.parametrize(
    ("method", "parameters"),
    [
        ("control_point", {"spacing": 0.25, "sweeps": 30, "feed": "at_once", "settle": False}),
        slow("digital_rsa", {"voxel_size": 0.2, "orientations": 480}),
        ("rsa", {"tries": 20_000}),
    ],
)
def test_a_rod_lies_along_a_diagonal(method, parameters):
    packing = vg.pack(vg.make_shape("cylinder", **ROD), CUBE, method=method, count=2, seed=1, **parameters)
    assert packing.count == 2
    assert vg.verify(packing).ok


def test_a_rod_goes_around_beside_itself():
    rods = vg.make_shape("cylinder", radius=0.3, height=5.0)
    packing = vg.pack(
        rods, vg.Box((4, 4, 4), "xyz"), method="digital_rsa", count=3, seed=1, voxel_size=0.2, orientations=96
    )
    assert packing.count == 3
    assert vg.verify(packing).ok


def test_the_messages():
    rod = vg.make_shape("cylinder", **ROD)
    with pytest.raises(GrainTooLargeError, match="none can fit in the container of 2 x 2 x 2, however it is turned"):
        vg.pack(rod, vg.Box((2, 2, 2)), method="rsa", count=2)
    with pytest.warns(PackingWarning, match=r"0 of 2 grains were placed before the method stopped \(steps\)"):
        vg.pack(rod, CUBE, method="rsa", count=2, tries=1, until="tries")
    with pytest.warns(PackingWarning, match=r"0 of 2 grains were placed before the method stopped \(saturated\)"):
        vg.pack(box(0.2, 0.2, 5.0), vg.Box((6, 6, 4)), method="rsa", aligned=True, count=2)


@pytest.mark.parametrize(
    ("scale", "container", "message"),
    [
        (4.1, vg.Box((4, 4, 8), "xy"), r"grain 1 is 4.1 wide: it contains a sphere wider than the period of 4"),
        (1e6, vg.Box((4, 4, 8), "z"), "contains a sphere wider than the period of 8"),
        (1e6, vg.Box((4, 4, 8)), "at most 1000 times as wide as the container is long, 8"),
        (1e6, vg.Sphere(4.0), "at most 1000 times as wide"),
    ],
)
def test_spheres_wider_than_a_period_or_beyond_all_proportion_are_refused(scale, container, message):
    places, scales = np.array([(1.0, 1, 1), (2, 2, 2)]), np.array([1.0, scale])
    given = {"position": places, "scale": scales}
    for refused in (
        lambda: vg.Packing.of(vg.shapes.sphere(), container, **given),
        lambda: vg.verify(Assembly.of([vg.shapes.sphere()], container, **given)),
        lambda: dataclasses.replace(vg.Packing.of(vg.shapes.sphere(), container, position=places), scale=scales),
    ):
        with pytest.raises(GrainTooLargeError, match=message):
            refused()


def test_files_with_a_huge_sphere_are_refused(tmp_path):
    path = tmp_path / "bed.csv"
    path.write_text("x,y,z,radius\n1,1,1,0.5\n2,2,2,1e4\n")
    huge = pytest.raises(GrainTooLargeError, match="grain 1 is 20000 wide")
    with huge, pytest.warns(PackingWarning, match="2 overlap others"):
        vg.load(path, container=vg.Box((4, 4, 4), "xy"))
    bed = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 4), "xy"), position=[(1, 1, 1), (2, 2, 2)])
    object.__setattr__(bed, "scale", np.array([1.0, 1e4]))
    vg.save(bed, tmp_path / "bed.vtp")
    with pytest.raises(FileFormatError, match="grain 1 is 10000 wide"):
        vg.load(tmp_path / "bed.vtp")


def test_rods_longer_than_periods_are_kept_while_their_images_can_be_counted():
    rod, slab = vg.make_shape("cylinder", radius=0.05, height=20.0), vg.Box((30, 30, 0.5), "xyz")
    bed = vg.Packing.of(rod, slab, position=[(1, 1, 0.2), (15, 15, 0.2)])
    # each crosses its own images at 0.5, 1, ..., 19.5, and touches that at 20
    assert vg.verify(bed).overlapping_pairs == 2 * 39
    with pytest.raises(GrainTooLargeError, match="more than 10000 of its periodic images"):
        vg.Packing.of(rod, vg.Box((0.5, 0.5, 0.5), "xyz"), position=[(0.2, 0.2, 0.2)])
