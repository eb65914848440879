"""Default voxels of searches of a whole lattice: as fine as seconds allow, and told where they do not."""

import warnings

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import LongRunWarning, PackingWarning
from voxgran.packing import method as packing_method
from voxgran.packing.digital.container_lattice import LONG, container_lattice
from voxgran.packing.draw import Request
from voxgran.packing.method import LONG_RUN
from voxgran.packing.pack import prepare_task
from voxgran.study.runs import Run, compute

BRICKS = [vg.make_shape("box", lengths=lengths) for lengths in ((1, 1.3, 0.7), (1, 2, 0.7))]
#: sizes that are all different
GRADED = vg.sizes.lognormal(median=1.0, sigma=0.4)


def task(shapes, container, method, *, sizes=None, count=None, **parameters):
    return prepare_task(Request(shapes, container, method, count=count, sizes=sizes, parameters=parameters))


def wide_mesh(width):
    solid = vg.make_shape("superquadric")
    return vg.ClosedMesh(vg.Shape.from_mesh(solid.vertices * width / np.ptp(solid.vertices, axis=0).max(), solid.faces))


def bricks_in_a_mesh(**parameters):
    sizes = vg.sizes.discrete([250, 500, 700], [1, 1, 1])
    return task(BRICKS, wide_mesh(5500), "digital_fill", sizes=sizes, count=4, orientations=3, **parameters)


@pytest.mark.parametrize("method", ["digital_fill", "digital_rsa"])
def test_scenes_that_take_seconds_keep_the_usual_voxels(method):
    made = task(vg.shapes.sphere(), vg.Box((6, 6, 6)), method)
    assert container_lattice(made.problem).voxel_size == made.problem.parameters.usual_voxel_size
    assert 0 < made.method.cost(made.problem).seconds < LONG


def test_voxels_are_larger_where_the_search_would_take_minutes():
    made = bricks_in_a_mesh()
    unit = made.problem.unit_length
    assert container_lattice(made.problem).voxel_size == pytest.approx(0.1, rel=0.35)
    assert made.method.cost(made.problem).seconds < LONG_RUN
    fine = bricks_in_a_mesh(voxel_size=unit / 20)
    assert fine.method.cost(fine.problem).seconds > 60
    # whoever gives the size of voxels gets it
    assert container_lattice(fine.problem).voxel_size == pytest.approx(1 / 20)


@pytest.mark.parametrize("factor", [2.0**-20, 2.0**10])
def test_default_voxels_do_not_depend_on_the_unit(factor):
    given = [task(BRICKS, wide_mesh(11.0 * one), "digital_fill", sizes=vg.sizes.fixed(one), count=4, orientations=3)
             for one in (1.0, factor)]  # fmt: skip
    sizes = [container_lattice(one.problem).voxel_size for one in given]
    assert sizes[0] == sizes[1] > 1 / 20


def test_aligned_primitives_have_fewer_poses_than_solids_of_any_form():
    # turned over, boxes look as before: 6 of 24 poses differ
    brick = vg.make_shape("box", lengths=(1, 1.3, 0.7))
    solid = vg.Shape.from_mesh(brick.vertices, brick.faces)
    seconds = [one.method.cost(one.problem).seconds for one in (
        task(shape, vg.Box((6, 6, 6)), "digital_rsa", voxel_size=0.1) for shape in (vg.shapes.sphere(), brick, solid)
    )]  # fmt: skip
    assert seconds[2] / seconds[1] == pytest.approx(4.0)
    assert seconds[1] > seconds[0]


def test_runs_of_minutes_are_told_before_they_start_with_what_shortens_them():
    started = []

    class StopError(Exception):
        """Raised instead of the first step."""

    def stop(step):
        started.append(step)
        raise StopError

    wide = {"sizes": GRADED, "count": 60}
    with pytest.warns(PackingWarning, match=r"about \d+ min: larger voxels \(voxel_size\)"), pytest.raises(StopError):
        vg.pack(BRICKS, wide_mesh(30.0), "digital_fill", on_step=stop, **wide)
    assert len(started) == 1
    made = task(BRICKS, wide_mesh(30.0), "digital_fill", **wide)
    assert container_lattice(made.problem).voxel_size == pytest.approx(0.1)
    assert made.method.cost(made.problem).seconds > LONG_RUN


@pytest.mark.parametrize("ratio", [4, 8, 16])
def test_sieve_curves_take_no_gigabytes(ratio):
    sizes = vg.sizes.sieve([1, ratio**0.5, ratio], [0, 0.5, 1], independent=True)
    for shape in (vg.shapes.sphere(), BRICKS[0]):
        made = prepare_task(
            Request(shape, vg.Sphere(4 * ratio**0.5), "digital_fill", solid_fraction=0.372, sizes=sizes)
        )
        assert made.method.cost(made.problem).memory < 2**28


def test_maps_are_dropped_after_the_last_grain_of_their_kind():
    made = task(BRICKS[0], vg.Box((4, 4, 4)), "digital_fill", sizes=vg.sizes.discrete([0.5, 1], [1, 1]), count=8)
    state = made.method.prepare(made.problem)
    while not state.stop_reason:
        state = made.method.advance(made.problem, state, 1)
        setting, waiting = state.derived["setting"], state.arrays["order"][state.done :]
        kept = {int(setting.oriented.kind[member]) for member in setting.maps}
        assert kept <= set(setting.kind[waiting].tolist())
    assert not setting.maps


@pytest.mark.parametrize(("method", "few", "many"), [("digital", 100, 30_000), ("control_point", 100, 3000)])
def test_walks_are_expected_to_take_seconds_or_say_so(method, few, many):
    def told(made):
        return packing_method.long_run(made.method, made.problem, made.method.cost(made.problem).seconds)

    for count, slow in ((few, False), (many, True)):
        edge = 2 * count ** (1 / 3)
        assert bool(told(task(BRICKS[0], vg.Box((edge, edge, edge)), method, count=count))) is slow
    # in a full container feeding waits for grains that sink
    assert "fewer grains take less" in told(task(BRICKS[0], vg.Box((14, 14, 14)), method))


@pytest.mark.usefixtures("forked_workers")
def test_studies_and_scenes_say_once_before_they_start_that_they_take_long(monkeypatch, tmp_path):
    base = {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [4, 4, 4]},
        "packing": {"method": "digital_fill", "count": 3},
        "measure": {"which": ["density"]},
    }
    study = vg.Study(base=base, axes={"packing.count": [3, 4]}, seeds=2)
    monkeypatch.setattr(packing_method, "LONG_RUN", 0.0)
    assert str(study.plan()).count("takes long ") == 2
    assert "note            method 'digital_fill' is expected" in str(vg.Scene.from_mapping(base).plan())
    with warnings.catch_warnings(record=True, action="always") as told:
        result = study.run(tmp_path / "study", workers=1)
        assert [one.category for one in told] == [LongRunWarning]
        text = str(told[0].message)
        assert text.startswith("packing.count 3: method 'digital_fill'")
        assert "1 of the other cells" in text
        bare = {"output": {"vtk": False, "report": False, "statistics": False}}
        vg.Scene.from_mapping(base | bare).run(tmp_path / "run")
    assert [one.category for one in told].count(LongRunWarning) == 2
    # which a run of the study does not say again
    assert result.computed == 4
    record = compute(Run(key="", cell="", mapping=base, seed=0))
    assert not record.failure
    assert not any("expected to take" in text for text in record.warnings)
