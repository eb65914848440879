"""What a packing does as a sequence of grains, and what it answers itself."""

import dataclasses
import pickle

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError


def three(**more):
    """Return two spheres and a cone in a box."""
    shapes = [vg.make_shape("sphere"), vg.make_shape("cone")]
    given = {"position": [[1, 1, 1], [3, 3, 3], [1, 3, 1]], "scale": [1, 1.5, 0.5], **more}
    return vg.Packing.of(shapes, vg.Box((4, 4, 4)), shape_id=[0, 1, 0], **given)


def test_grains_are_counted_and_visited():
    packing = three()
    assert len(packing) == packing.count == 3
    grains = list(packing)
    assert [grain.diameter for grain in grains] == pytest.approx([1, 1.5, 0.5])
    assert grains[1].shape == packing.shapes[1]
    assert (packing[-1].position == (1, 3, 1)).all()
    assert packing[0].scale == 1
    assert packing[0].orientation.tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(
    ("chosen", "kept"),
    [
        (slice(1, None), [1, 2]),
        ([True, False, True], [0, 2]),
        (np.array([2, 0]), [2, 0]),
        ([], []),
        (np.zeros(3, bool), []),
        (np.zeros(0, int), []),
        ((np.array([0, 2]),), [0, 2]),
        (np.array([True, False, True]).nonzero(), [0, 2]),
    ],
)
def test_some_grains_are_a_packing(chosen, kept):
    packing = three(provenance={"method": "by hand"})
    some = packing[chosen]
    assert isinstance(some, vg.Packing)
    assert (some.position == packing.position[kept]).all()
    assert (some.shape_id == packing.shape_id[kept]).all()
    assert some.provenance["chosen"] == {"count": len(kept), "of": 3}
    assert some.provenance["method"] == "by hand"
    assert some


@pytest.mark.parametrize(
    "chosen",
    [
        *([True], "large", [0.5], None, slice("a")),
        *(True, np.True_, [[0, 1]], [[]], np.argwhere([True, False, True]), np.ones((2, 2)).nonzero()),
        *(np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros(0, bool), np.zeros(0), ()),
    ],
    ids=str,
)
def test_what_chooses_no_grain_is_an_error(chosen):
    with pytest.raises(IndexError, match="give an index, a slice, a mask of 3"):
        three()[chosen]


@pytest.mark.parametrize("chosen", [3, -4, [0, 3], (3,), np.uint8(3)], ids=str)
def test_an_index_out_of_range_is_an_error(chosen):
    with pytest.raises(IndexError, match=r"index -?[34] is out of range: it must be from -3 to 2"):
        three()[chosen]
    with pytest.raises(IndexError, match="the packing has no grains"):
        three()[[]][chosen]


def test_grains_of_equal_shape_and_pose_are_equal():
    packing = three()
    assert packing[0] in packing
    assert packing[0] == three(position=[[1, 1, 1], [2, 2, 2], [1, 3, 1]])[0]
    assert packing[2] not in packing[:2]
    assert len({packing[0], three()[0], packing[1]}) == 2
    assert packing[0] != 1


def test_a_part_or_a_sum_says_how_it_came_about():
    record = {"asked": {"count": 3}}
    full = three(stop_reason="saturated", provenance=record)
    assert [full[some].stop_reason for some in (slice(2), [2, 1, 0], [0, 0, 1])] == ["count", "saturated", "count"]
    assert (full + full).stop_reason == "count"
    settled = three(stop_reason="settled")
    assert (settled + settled).stop_reason == "settled"
    assert (settled + three(stop_reason="steps")).stop_reason == "count"
    parts = (full[:2], full + full)
    parts[0].provenance["asked"]["count"] = parts[1].provenance["parts"][0]["asked"]["count"] = 5
    assert full.provenance["asked"]["count"] == 3


def test_one_shape_is_enough():
    sphere = vg.make_shape("sphere")
    assert vg.Packing.of(sphere, vg.Box((2, 2, 2)), position=[[1, 1, 1]]).shapes == (sphere,)
    with pytest.raises(InputError, match="it must be a Shape or a list of them"):
        vg.Packing.of("sphere", vg.Box((2, 2, 2)), position=[[1, 1, 1]])


def test_what_is_kept_cannot_be_changed():
    packing = three()
    for name in ("diameter", "volumes", "surface_areas", "matrices", "bounding_radii"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(packing, name)[0] = 2.0


def test_two_packings_are_put_together():
    packing = three()
    both = packing[:1] + packing[1:]
    assert both == packing
    assert len(both.shapes) == 2
    assert len(packing + packing) == 6
    assert both.provenance["method"] == "sum"
    taller = dataclasses.replace(packing, container=vg.Box((4, 4, 5)))
    for other, message in (
        (three(unit="mm"), "unit of the packings is .*state the unknown one"),
        (three(gravity=None), "gravity of the packings is .*give one the gravity"),
        (taller, r"container .lengths. of the packings is .*5.0.*make one anew in the container"),
    ):
        with pytest.raises(InputError, match=message):
            packing + other
    with pytest.raises(InputError, match="convert one with to_unit"):
        three(unit="m") + three(unit="mm")
    with pytest.raises(TypeError):
        packing + 1


def test_equal_packings():
    packing = three()
    assert packing == three(provenance={"seconds": 3})
    assert hash(packing) == hash(three())
    assert packing != three(contact_gap=0.1)
    assert packing != three(scale=[1, 1.5, 0.6])
    assert packing != packing[:2]
    assert packing != packing[[2, 1, 0]]
    shapes = [vg.shapes.cone(), vg.shapes.box(), vg.shapes.sphere(), vg.shapes.sphere()]
    again = vg.Packing.of(shapes, packing.container, position=packing.position, scale=packing.scale, shape_id=[2, 0, 3])
    assert again == packing
    assert packing != dataclasses.replace(again, shape_id=np.array([2, 1, 3]))
    zero, minus = (three(position=[[x, 1, 1], [3, 3, 3], [1, 3, 1]]) for x in (0.0, -0.0))
    assert zero == minus
    assert hash(zero) == hash(minus)
    assert packing != 3


def test_it_survives_pickling():
    packing = three(unit="mm", provenance={"method": "by hand"})
    packing.contacts(1.0)
    again = pickle.loads(pickle.dumps(packing))
    assert again == packing
    assert again.provenance == packing.provenance
    assert not again.position.flags.writeable


def test_tables_and_meshes():
    packing = three()
    table = packing.to_dataframe()
    assert list(table["shape"]) == ["sphere", "cone", "sphere"]
    assert table[["x", "y", "z"]].to_numpy() == pytest.approx(packing.position)
    assert table["diameter"].to_numpy() == pytest.approx(packing.diameter)
    mesh = packing.to_pyvista()
    assert set(mesh.cell_data["grain"]) == {0, 1, 2}
    assert mesh.volume == pytest.approx(packing.volumes.sum(), rel=0.01)


def test_it_verifies_measures_and_saves_itself(tmp_path, monkeypatch):
    packing = three()
    assert str(packing.verify()) == vg.verify(packing).summary()
    assert "1 pairs" in str((packing + packing).verify(tolerance=0.5)) or not (packing + packing).verify().ok
    assert packing.measure("coordination").equals(vg.measure(packing, which="coordination"))
    packing.save(tmp_path / "a.vtp")
    assert vg.load(tmp_path / "a.vtp") == packing
    with pytest.raises(vg.VoxgranError, match="overwrite"):
        packing.save(tmp_path / "a.vtp")
    monkeypatch.delenv("DISPLAY", raising=False)
    assert np.asarray(packing.plot(color_by="shape")).shape == (900, 900, 3)
    with pytest.raises((InputError, UnknownNameError), match="color"):
        packing.plot(color_by="taste")
    with pytest.raises(InputError, match=r"^color_by is 'taste'"):
        vg.plot(vg.shapes.cone(), color_by="taste")
    assert vg.measure(packing, "coordination").equals(packing.measure("coordination"))
    with pytest.raises(InputError, match="which is 2"):
        packing.measure(2)


def test_a_window_shows_grains_in_colour(monkeypatch):
    shown, texts = [], []

    class Plotter:
        def __init__(self, **options):
            self.meshes = []
            self.window_size = options["window_size"]

        def add_actor(self, actor, **options):
            if hasattr(actor, "GetInput"):
                texts.append(actor.GetInput())

        def add_mesh(self, mesh, **look):
            self.meshes.append((mesh, look))

        def show(self):
            shown.append(self.meshes)

    monkeypatch.setattr("voxgran.report.notebook._has_window", lambda: True)
    monkeypatch.setattr("pyvista.Plotter", Plotter)
    assert three().plot(color_by="shape") is None
    assert texts[-1] == "number of the shape"
    assert [text[:3] for text in texts[:-1]] == ["0: ", "1: "]
    texts.clear()
    three().plot(color_by="shape", legend=False)
    assert texts == []
    shown.pop()
    assert vg.shapes.cone().plot() is None
    (_, (grains, look)), ((_, plain),) = shown
    assert set(grains.cell_data[look["scalars"]]) == {0, 1}
    assert "color" in plain
    vg.Packing.of([vg.shapes.cone()], vg.Box((2, 2, 2)), position=np.zeros((0, 3))).plot()
    assert [look.get("style") for _, look in shown[-1]] == ["wireframe"]
