"""What `pack` and `make_shape` are given: other types and lengths that cannot be are refused in one sentence."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, TooLargeError, UnknownNameError, shown
from voxgran.packing import draw

SPHERE, BOX = vg.make_shape("sphere"), vg.Box((4, 4, 4))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"shapes": "sphere"}, "shapes is 'sphere': it must be a Shape"),
        ({"shapes": ["sphere"]}, "shapes.0. is 'sphere': it must be a Shape"),
        ({"shapes": None}, "shapes is None"),
        ({"shapes": 3}, "shapes is 3"),
        ({"container": (4, 4, 4)}, "container is .4, 4, 4.: it must be a container"),
        ({"container": vg.shapes.box()}, "a Shape is no container; give a Box, or ClosedMesh.shape."),
        ({"container": vg.make_shape("disk")}, "a Shape is no container; give a Rectangle"),
        ({"container": None}, "container is None"),
        ({"sizes": 3}, "sizes is 3: it must be a size distribution"),
        ({"start": 3}, "start is 3: it must be a Packing"),
        ({"checkpoint": 3}, "checkpoint is 3: it must be the path"),
        ({"resume": "x"}, "resume is 'x': it must be True or False"),
        ({"resume": None}, "resume is None"),
        ({"on_step": 3}, "on_step is 3: it must be a function"),
        ({"recorder": 3}, "recorder is 3: it must have the methods"),
    ],
)
def test_other_types_are_refused(changed, words):
    given = {"shapes": SPHERE, "container": BOX, "method": "rsa", "count": 2, **changed}
    with pytest.raises(InputError, match=words):
        vg.pack(given.pop("shapes"), given.pop("container"), **given)


def test_more_grains_than_can_be_held_are_refused_before_they_are_drawn():
    for many in (10**8 + 1, 10**12, 10**30, 10**400):
        with pytest.raises(TooLargeError, match=f"count is {shown(many)}: at most 100000000 grains"):
            vg.pack(SPHERE, BOX, method="rsa", count=many)


@pytest.mark.parametrize(
    ("method", "parameters", "error", "words"),
    [
        (["rsa"], {}, UnknownNameError, "packing method .'rsa'. is unknown"),
        ("digital", {"sweeps": 10**30}, InputError, "sweeps is 10*: it must be at most 1000000000; give less"),
        ("digital", {"orientations": 10**12}, InputError, "orientations is 10*: it must be at most 1000000"),
        ("digital", {"voxel_size": 1e-9}, TooLargeError, "voxel_size is 1e-09: the voxels .* more than 128 GiB"),
        ("digital_rsa", {"voxel_size": 1e-59}, TooLargeError, "voxel_size is 1e-59"),
        ("control_point", {"period": 10**30}, InputError, "period is 10*: it must be at most"),
    ],
)
def test_absurd_values_are_refused(method, parameters, error, words):
    with pytest.raises(error, match=words):
        vg.pack(SPHERE, BOX, method=method, count=2, **parameters)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: vg.verify(3), "packing is 3: it must be a Packing; load or pack one"),
        (lambda: vg.measure(3), "packing is 3"),
        (lambda: vg.deform(3), "packing is 3"),
        (lambda: vg.save_report(3, "x.html"), "packing is 3"),
        (lambda: vg.save_scene(3, "x.vtm"), "packing is 3"),
        (lambda: vg.voxelize(3, voxel_size=1), "shape is 3: it must be a Shape; make_shape and load_shape make one"),
        (lambda: vg.sample_surface(3, spacing=1), "shape is 3"),
        (lambda: vg.save_shape(3, "x.stl"), "shape is 3"),
        (lambda: vg.fit_clump(3), "shape_or_voxels is 3: it must be a Shape or Voxels"),
        (lambda: vg.shape_of_cloud(3), "cloud is 3: it must be a Cloud; load_cloud reads one"),
        (lambda: vg.Scene.from_mapping(3), "scene is 3: it must be a mapping of sections"),
    ],
)
def test_what_is_no_packing_and_no_shape_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1e-61, 1e61, 1e120, 1e300])
@pytest.mark.filterwarnings("error")
def test_lengths_beyond_all_units_are_refused(size):
    for call in (
        lambda: vg.pack(SPHERE.scaled(size), BOX, method="rsa"),
        lambda: vg.Box((4, 4, 4 * size)),
        lambda: vg.Rectangle((4 * size, 4)),
        lambda: vg.Cylinder(size, 4),
        lambda: vg.Sphere(4 * size),
        lambda: vg.sizes.fixed(size),
        lambda: vg.voxelize(SPHERE, voxel_size=size),
    ):
        with pytest.raises(InputError, match="must be between 1e-60 and 1e\\+60; choose another unit of lengths"):
            call()
    corners = ((0, 0), (size, 0), (size, size), (0, size))
    for family, parameters in (
        ("sphere", {"diameter": size}),
        ("cylinder", {"diameter": size}),
        ("solid_union", {"diameter": size}),
        ("box", {"lengths": (1, 1, size)}),
        ("polygon", {"vertices": corners}),
    ):
        with pytest.raises(InputError, match="must be between 1e-60 and 1e\\+60"):
            vg.make_shape(family, **parameters)


@pytest.mark.parametrize("size", [1e-59, 1e59])
@pytest.mark.filterwarnings("error")
def test_lengths_just_within_are_taken(size):
    packing = vg.pack(vg.make_shape("sphere", diameter=size), vg.Box((4 * size,) * 3), method="rsa", count=9, seed=1)
    usual = vg.pack(SPHERE, BOX, method="rsa", count=9, seed=1)
    assert packing.position / size == pytest.approx(usual.position, rel=1e-12)
    assert packing.solid_fraction == pytest.approx(usual.solid_fraction)
    assert vg.verify(packing).ok


def test_counts_far_beyond_memory_or_container_are_refused_by_their_first_grains(monkeypatch):
    drawn = []
    original = draw._draw_block
    monkeypatch.setattr(draw, "_draw_block", lambda *given: drawn.append(given[3]) or original(*given))
    with pytest.raises(InputError, match=r"count is 1000000: these grains have \S+ times the volume of the container"):
        vg.pack(SPHERE, BOX, method="gravity", count=10**6)
    assert drawn == [draw.PROBE]
    monkeypatch.setattr("voxgran.shapes.size_laws.listed.memory_limit", lambda: 10**9)
    with pytest.raises(TooLargeError, match=r"count is 10000000: these grains need at least 2\.8 GiB.*has 0\.9 GiB"):
        vg.pack(SPHERE, BOX, method="rsa", count=10**7)
    assert drawn == [draw.PROBE]


@pytest.mark.parametrize(
    "method", ["gravity", "rsa", "digital", "digital_fill", "digital_rsa", "deposition", "advancing_front"]
)
@pytest.mark.parametrize(
    ("shape", "container"),
    [
        (vg.shapes.box(lengths=(2, 3, 4)), vg.Box((3, 4, 2), origin=(1, 1, 1))),
        (vg.shapes.cylinder(radius=1, height=3), vg.Cylinder(1, 3)),
        (vg.shapes.sphere(diameter=2), vg.Sphere(1)),
        (vg.make_shape("disk", diameter=2), vg.Rectangle((2, 2))),
    ],
    ids=["box", "cylinder", "sphere", "disk"],
)
def test_a_grain_that_is_as_large_as_its_container_is_placed(method, shape, container):
    """In the one place that it has, where it cannot move."""
    packing = vg.pack(shape, container, method, count=1)
    assert packing.count == 1
    assert vg.verify(packing).ok


def test_a_grain_that_fills_its_container_is_all_that_fills_it():
    cube, box = vg.shapes.box(lengths=(2, 2, 2)), vg.Box((2, 2, 2))
    bed = vg.pack(cube, box, "gravity")
    assert (bed.count, bed.stop_reason) == (1, "settled")
    turn = np.array([[1.0, 0.3, 0.0, 0.0]]) / np.sqrt(1.09)
    with pytest.warns(PackingWarning, match="0 of 1 grains"):
        assert not vg.pack(cube, box, "rsa", count=1, orientations=turn, tries=100).count


def test_a_sphere_between_all_walls_leaves_room_for_others_in_the_corners():
    spheres = {"diameter": [2.0, 0.2, 0.2]}
    assert vg.pack(grains=spheres, container=vg.Box((2, 2, 2)), method="rsa").count == 3
