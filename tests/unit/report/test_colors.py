"""Colours, close-ups and turns: the numbers behind them are right and the pictures show something."""

import io

import numpy as np
import pytest
from PIL import Image

import voxgran as vg
from voxgran._base.errors import InputError, OutputExistsError
from voxgran.report.colors import coloring
from voxgran.report.facts import shape_rows
from voxgran.report.scenes import closeups_of, numbers_of_grain, picture_contacts, picture_packing
from voxgran.report.stage import round_length, stage_of
from voxgran.report.turntable import animated, save_turntable
from voxgran.report.view import view_data

WINDOW = (240, 240)


@pytest.fixture
def row():
    """Three spheres that touch in a row, and one alone, across a periodic face."""
    position = [(0.5, 2, 2), (1.5, 2, 2), (2.5, 2, 2), (5.0, 2, 2)]
    return vg.Packing.of([vg.make_shape("sphere")], vg.Box((6, 4, 4), "x"), position=position, unit="mm")


def test_values_are_those_of_the_grains(row):
    assert coloring(row, "coordination").values.tolist() == [1, 2, 1, 0]
    assert coloring(row, "distance").values.tolist() == pytest.approx([1, 1, 1, 1.5])
    assert coloring(row, "diameter").values.tolist() == pytest.approx([1, 1, 1, 1])
    assert coloring(row, "diameter").unit == "mm"
    assert coloring(row, "shape").values.tolist() == [0, 0, 0, 0]
    with pytest.raises(InputError, match="color_by is 'size'"):
        coloring(row, "size")


def test_materials_are_told_apart():
    sphere = vg.make_shape("sphere")
    where = [(1, 1, 1), (3, 1, 1), (3, 3, 1)]
    bed = vg.Packing.of([sphere] * 2, vg.Box((4, 4, 4)), position=where, shape_id=[0, 1, 1], density=(7800, 2500))
    assert coloring(bed, "density").values.tolist() == [7800, 2500, 2500]
    assert [row[0] for row in shape_rows(bed)] == ["sphere (density 2500)", "sphere (density 7800)"]
    head, arrays = view_data(bed, np.arange(3), 100)
    names = [color["name"] for color in head["colors"]]
    assert sorted(head["shapes"]) == ["sphere (density 2500)", "sphere (density 7800)"]
    assert arrays["values"][names.index("density")].tolist() == [7800, 2500, 2500]
    same = vg.Packing.of([sphere], vg.Box((4, 4, 4)), position=where, density=2500)
    assert "density" not in [color["name"] for color in view_data(same, np.arange(3), 100)[0]["colors"]]
    assert [row[0] for row in shape_rows(same)] == ["sphere"]


@pytest.mark.parametrize("color_by", ["diameter", "shape", "coordination", "distance"])
def test_pictures_are_coloured(packing, color_by):
    picture = picture_packing(packing, color_by=color_by, window=WINDOW)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
    if color_by != "diameter":
        assert (picture != picture_packing(packing, window=WINDOW)).any()


def test_the_other_side_is_another_picture_of_the_same_size(packing):
    one, other = (picture_packing(packing, window=WINDOW, turn=turn) for turn in (0.0, 90.0))
    assert one.shape == other.shape
    assert (one != other).mean() > 0.05


def test_a_close_up_shows_the_grain_with_the_most_neighbours(row, packing):
    picture = picture_contacts(row, window=WINDOW)
    teal = (picture[..., 1].astype(int) - picture[..., 0]) > 60
    red = (picture[..., 0].astype(int) - picture[..., 1]) > 40
    assert 0.02 < teal.mean() < 0.5
    assert red.sum() > 5
    apart = vg.Packing.of([vg.make_shape("sphere")], vg.Box((9, 9, 9)), position=[(1, 1, 1), (7, 7, 7)])
    assert picture_contacts(apart) is None
    assert picture_contacts(packing, window=WINDOW).shape == (240, 240, 3)
    # translucent surfaces are smooth: of neighbouring pixels few differ by more than shading does
    steps = np.abs(np.diff(picture[..., 2].astype(int), axis=1))
    assert ((steps > 5) & (steps < 30)).mean() < 0.02


@pytest.mark.parametrize(
    ("most", "length"), [(1.0, 1.0), (0.99, 0.5), (4.9, 2.0), (5.0, 5.0), (123.0, 100.0), (3e-7, 2e-7)]
)
def test_a_scale_bar_has_a_round_length(most, length):
    assert round_length(most) == pytest.approx(length, rel=1e-12)


def test_a_turn_is_an_animated_picture(row, tmp_path):
    steps = []
    save_turntable(row, tmp_path / "turn.gif", frames=5, window=(120, 120), on_step=steps.append)
    with Image.open(tmp_path / "turn.gif") as picture:
        assert picture.n_frames == 5
        assert picture.size == (120, 120)
        assert picture.info["loop"] == 0
    assert [step.done for step in steps] == [1, 2, 3, 4, 5]
    with pytest.raises(OutputExistsError):
        save_turntable(row, tmp_path / "turn.gif", frames=2)
    with pytest.raises(InputError, match="frames is 0"):
        save_turntable(row, tmp_path / "other.gif", frames=0)
    plain = animated(iter([np.zeros((4, 4, 3), np.uint8), np.full((4, 4, 3), 255, np.uint8)]))
    with Image.open(io.BytesIO(plain)) as picture:
        picture.seek(1)
        assert np.asarray(picture.convert("RGB")).min() > 250


def test_a_grain_alone_is_turned_as_it_lies():
    turn = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    rod = vg.make_shape("box", lengths=(3, 1, 1))
    packing = vg.Packing.of([rod], vg.Box((9, 9, 9)), position=[(4, 5, 6)], orientation=[turn], scale=[2.0])
    for name, draw in closeups_of(packing, 0).items():
        with stage_of(WINDOW) as stage:
            corners = draw(stage)
            low, high = np.reshape(stage.bounds, (3, 2)).T
        # a body of 6 x 2 x 2, along y
        size = 2 * np.ptp(rod.vertices, axis=0)[[1, 0, 2]]
        assert np.ptp(corners, axis=0) == pytest.approx(size), name
        assert high - low == pytest.approx(size, abs=0.25 * size.min()), name
        assert (low + high) / 2 == pytest.approx([4, 5, 6], abs=0.1), name


def test_the_numbers_of_a_grain_are_those_of_its_colours(row):
    told = {fact.label: fact.value for fact in numbers_of_grain(row, 1)}
    assert told["grain"] == "1"
    assert told["coordination number"] == f"{coloring(row, 'coordination').values[1]:g}"
    assert told["number of the shape"].endswith("sphere")
    assert told["sphericity"] == "1"
