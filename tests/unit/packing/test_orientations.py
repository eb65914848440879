"""Orientations that packings are asked for: each method places grains in them or begins with them."""

import numpy as np
import pytest
from scipy import special

import voxgran as vg
from voxgran._base.errors import CheckpointError, InputError
from voxgran._base.seeds import stream
from voxgran.contacts.verify import verify
from voxgran.geometry.rotation import random_rotations

ROD = vg.shapes.ellipsoid(semi_axes=(0.4, 0.4, 1.0))
PLATE = vg.shapes.ellipsoid(semi_axes=(1.0, 1.0, 0.3))
LONG = vg.make_shape("polygon", stretch=2.0)
#: parameters of the methods that keep the orientations; containers of 3 and 2 dimensions
KEEPING = {
    "advancing_front": {},
    "deposition": {},
    "digital": {"settle": False, "voxel_size": 0.1},
    "digital_fill": {"voxel_size": 0.1},
    "digital_rsa": {"voxel_size": 0.1},
    "growth": {},
    "random_apollonian": {},
    "rsa": {},
    "tetrahedral": {},
    "voronoi_fill": {"smoothing": 3, "rounds": 1},
}
BEGINNING = {"control_point": {"settle": False, "rotation_share": 0.0, "spacing": 0.2}}


def box(dimension):
    return vg.Box((6, 6, 6)) if dimension == 3 else vg.Rectangle((9, 9))


def tensor_of(packing, which=""):
    return packing.measure("fabric")["fabric"][f"orientation_tensor{which}"].values


@pytest.mark.filterwarnings("ignore::voxgran.PackingWarning")
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("method", [*KEEPING, *BEGINNING])
def test_methods_place_grains_as_asked(method, dimension):
    count = None if method == "tetrahedral" else 8
    axis = (1.0, 2.0) if dimension == 2 else (1.0, 2.0, -2.0)
    asked = vg.orientations.aligned(axis)
    shape = LONG if dimension == 2 else ROD
    given = KEEPING | BEGINNING
    packing = vg.pack(shape, box(dimension), method, count=count, seed=2, orientations=asked, **given[method])
    unit = np.array(axis) / np.linalg.norm(axis)
    assert packing.count >= 4
    assert tensor_of(packing) == pytest.approx(np.outer(unit, unit), abs=1e-9)
    assert tensor_of(packing, "_asked") == pytest.approx(np.outer(unit, unit), abs=1e-14)
    assert verify(packing, tolerance=1e-6).ok
    assert packing.provenance["asked"]["orientations"] == asked.to_mapping()
    if dimension == 3:
        # the rotation about the axis is not the same
        assert len(np.unique(packing.orientation.round(6), axis=0)) > 3


@pytest.mark.parametrize("method", ["expand", "gravity", "jam"])
def test_methods_that_move_grains_begin_as_asked(method):
    from voxgran.packing.beds import method as beds
    from voxgran.packing.draw import Request
    from voxgran.packing.jamming import method as jamming
    from voxgran.packing.pack import prepare_task

    request = Request(ROD, box(3), method, count=8, orientations=vg.orientations.aligned("x"))
    problem = prepare_task(request).problem
    first = beds._start(problem, 8)[0] if method == "gravity" else jamming.first_assembly(problem)
    assert tensor_of(
        vg.Packing.of([ROD], box(3), position=first.position, orientation=first.orientation)
    ) == pytest.approx(np.diag([1.0, 0, 0]), abs=1e-12)


@pytest.mark.slow
def test_settling_changes_the_orientations_of_a_bed():
    # numbers of docs/guide/packing.md
    rods, upright = vg.shapes.spherocylinder(aspect=3), vg.orientations.watson("z", 20)
    placed = vg.pack(rods, vg.Box((5, 5, 5)), "rsa", count=60, orientations=upright)
    poured = vg.pack(rods, vg.Box((5, 5, 12)), "gravity", count=60, orientations=upright)
    assert tensor_of(placed)[2, 2] == pytest.approx(0.95, abs=0.005)
    assert tensor_of(placed, "_error")[2, 2] == pytest.approx(0.01, abs=0.005)
    assert tensor_of(poured)[2, 2] == pytest.approx(0.79, abs=0.05)
    assert tensor_of(poured, "_error")[2, 2] == pytest.approx(0.04, abs=0.01)
    assert tensor_of(poured, "_asked")[2, 2] == pytest.approx(0.95, abs=0.005)


def test_what_is_placed_is_what_is_asked_within_its_error():
    law = vg.orientations.watson("z", 4.0)
    packing = vg.pack(ROD, vg.Box((16, 16, 16)), "rsa", count=600, orientations=law, seed=4)
    fabric = packing.measure("fabric")["fabric"]
    asked, error = fabric.orientation_tensor_asked.values, fabric.orientation_tensor_error.values
    along = 1 / (2 * 2.0 * special.dawsn(2.0)) - 1 / 8
    assert asked == pytest.approx(np.diag([(1 - along) / 2] * 2 + [along]), abs=1e-12)
    assert 0.005 < error[2, 2] < 0.015
    assert np.abs((fabric.orientation_tensor.values - asked) / error).max() < 4
    assert fabric.orientation_tensor.values == pytest.approx(fabric.sel(vector="long_axes").second_order.values)


def test_random_orientations_are_those_of_today():
    packed = [vg.pack(ROD, box(3), "rsa", count=8, orientations=law) for law in (None, vg.orientations.random())]
    assert packed[0].orientation.tobytes() == packed[1].orientation.tobytes()
    assert "orientations" not in packed[0].provenance["asked"]
    assert packed[1].provenance["asked"]["orientations"]["kind"] == "random"


def test_short_axes_and_vectors_are_those_of_the_body():
    law = vg.orientations.aligned("x", body_axis="short")
    plates = vg.pack([PLATE, ROD], box(3), "rsa", count=4, orientations=law, weights=[1, 0])
    assert plates.matrices[:, 0, 2] == pytest.approx(np.full(4, plates.matrices[:, 0, 2]).round(), abs=1e-12)
    assert np.abs(plates.matrices[:, 0, 2]) == pytest.approx(1.0)
    cubes = vg.pack(
        vg.shapes.box(), box(3), "rsa", count=4, orientations=vg.orientations.aligned("z", body_axis=(1, 1, 1))
    )
    assert cubes.matrices @ np.ones(3) == pytest.approx(np.tile([0, 0, np.sqrt(3.0)], (4, 1)), abs=1e-12)


def test_a_list_gives_each_grain_its_own():
    turns = random_rotations(stream(1, "list"), 3)
    rods = [ROD.scaled(size) for size in (0.5, 0.7, 0.6)]
    packing = vg.pack(grains=rods, container=box(3), method="rsa", orientations=turns)
    assert packing.orientation[np.argsort(packing.grain_id)] == pytest.approx(turns, abs=1e-15)
    assert packing.provenance["asked"]["orientations"] == {"kind": "given", "count": 3}
    assert "orientation_tensor_asked" not in packing.measure("fabric")["fabric"]


def test_grains_of_a_start_keep_their_own():
    law = vg.orientations.aligned("x")
    start = vg.pack(ROD, box(3), "rsa", count=3)
    more = vg.pack(ROD, box(3), "rsa", count=3, start=start, orientations=law, seed=1)
    assert more.orientation[:3].tobytes() == start.orientation.tobytes()
    assert tensor_of(more[3:]) == pytest.approx(np.diag([1.0, 0, 0]), abs=1e-12)


def test_spheres_have_none():
    law = vg.orientations.watson("z", 4)
    balls = [vg.pack(vg.shapes.sphere(), box(3), "rsa", count=8, orientations=one) for one in (None, law)]
    assert balls[0].position.tobytes() == balls[1].position.tobytes()
    mixed = vg.pack([vg.shapes.sphere(), ROD], box(3), "digital_rsa", count=4, orientations=law, voxel_size=0.2)
    assert mixed.count == 4


def test_a_whole_number_is_the_parameter_of_the_method():
    one, other = (
        vg.pack(ROD, box(3), method, count=3, settle=False, **more)
        for method, more in (("digital", {"orientations": 1}), (vg.methods.Digital(orientations=1), {}))
    )
    assert one.orientation.tobytes() == other.orientation.tobytes()


def test_files_keep_what_was_asked(tmp_path):
    packing = vg.pack(ROD, box(3), "rsa", count=8, orientations=vg.orientations.tensor(np.diag([0.6, 0.3, 0.1])))
    vg.save(packing, tmp_path / "fibres.vtp")
    again = vg.load(tmp_path / "fibres.vtp")
    assert tensor_of(again, "_asked") == pytest.approx(np.diag([0.6, 0.3, 0.1]))
    assert tensor_of(again) == pytest.approx(tensor_of(packing))


def test_another_distribution_does_not_resume_a_checkpoint(tmp_path):
    given = {"count": 8, "checkpoint": tmp_path / "run"}
    vg.pack(ROD, box(3), "rsa", orientations=vg.orientations.aligned("x"), **given)
    with pytest.raises(CheckpointError):
        vg.pack(ROD, box(3), "rsa", orientations=vg.orientations.aligned("y"), resume=True, **given)


@pytest.mark.parametrize(
    ("shape", "container", "method", "asked", "more", "words"),
    [
        (ROD, box(3), "rsa", np.eye(4)[:2], {}, "2 rows and there are 3 grains"),
        (ROD, box(3), "rsa", "aligned", {}, "orientations is 'aligned'"),
        (ROD, box(3), "rsa", 24, {}, "orientations is 24: it must be a distribution"),
        (ROD, box(3), vg.methods.Digital(), 24, {}, "orientations is 24: it must be a distribution"),
        (LONG, box(2), "rsa", np.tile([0.0, 1, 0, 0], (3, 1)), {}, "rotate about z only"),
        (LONG, box(2), "rsa", vg.orientations.aligned("z"), {}, "must lie in the plane"),
        (vg.shapes.box(), box(3), "rsa", vg.orientations.aligned("z"), {}, "'box' has no distinct long axis"),
        (vg.shapes.box(), box(3), "rsa", vg.orientations.aligned("z"), {"aligned": True}, "aligned is True"),
        (ROD, box(3), "random_apollonian", vg.orientations.aligned("z"), {"rotate": 3}, "rotate is 3"),
        (ROD, box(3), "voronoi_fill", vg.orientations.aligned("z"), {"fill": "cells"}, "fill is 'cells'"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(shape, container, method, asked, more, words):
    with pytest.raises(InputError, match=words):
        vg.pack(shape, container, method, count=3, orientations=asked, **more)
