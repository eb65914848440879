"""Legends and colour bars say what the colours of a picture mean, beside the packing and within the picture."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import colormaps

import voxgran as vg
from voxgran.report.colors import ENTRIES, LEFT, RIGHT, TICKS, Coloring, coloring, legend_of
from voxgran.report.facts import headline
from voxgran.report.figures import curves_of, figures_of
from voxgran.report.scenes import picture_cut, picture_packing
from voxgran.report.stage import add_container, add_scale_bar, keep_written, shot, stage_of, text_size, text_width

WINDOW = (320, 300)
ENDS = [np.round(255 * np.array(colormaps["viridis"](end)[:3])) for end in (0.0, 1.0)]


@pytest.fixture
def two():
    """Return three spheres of two densities."""
    sphere, where = vg.make_shape("sphere"), [(1, 1, 1), (3, 1, 1), (3, 3, 1)]
    box = vg.Box((4, 4, 4))
    return vg.Packing.of([sphere] * 2, box, position=where, shape_id=[0, 1, 1], density=(7800, 2500), unit="mm")


def texts(packing, color_by, window=(900, 900)):
    return [label[0] for label in legend_of(coloring(packing, color_by), window).labels]


def share(picture, color):
    """Return the share of the pixels that have exactly a colour, as unlit tiles have it."""
    return float((np.abs(picture.astype(float) - color).max(axis=2) <= 1).mean())


def test_densities_and_shapes_are_listed_with_their_colours(two):
    assert texts(two, "density") == ["2500", "7800", "density of the material, in the unit given"]
    shapes = ["0: sphere (density 7800)", "1: sphere (density 2500)"]
    assert texts(two, "shape") == [*shapes, "number of the shape"]
    legend = legend_of(coloring(two, "density"), WINDOW)
    np.testing.assert_allclose(255 * legend.colors, ENDS, atol=1)
    for draw in (picture_packing, picture_cut):
        picture = draw(two, color_by="density", window=WINDOW)
        assert picture.shape == (300, 320, 3)
        strip = picture[-round(legend.height * 300) :]
        bare = draw(two, color_by="density", window=WINDOW, legend=False)
        assert all(share(strip, color) > 0.002 for color in ENDS)
        assert all(share(bare, color) < 5e-4 for color in ENDS)


def test_the_page_lists_densities_with_their_colours_below_the_pictures(two, tmp_path, jagged_pictures):
    vg.save_report(two, tmp_path / "page.html", color_by="density", interactive=False)
    text = (tmp_path / "page.html").read_text()
    line = text[text.index("Colour: density of the material, in the unit given") :].partition("</p>")[0]
    assert '<b style="background: #440154"></b> 2500' in line
    assert '<b style="background: #fde725"></b> 7800' in line


def test_values_have_a_bar_with_name_unit_and_numbers(packing):
    *numbers, title = texts(packing, "diameter")
    assert title == "equivalent diameter (mm)"
    marks = np.array([float(text) for text in numbers])
    low, high = coloring(packing, "diameter").limits
    assert 2 <= len(marks) <= TICKS + 1
    assert low <= marks.min() < marks.max() <= high
    # the numbers stand where their colours are
    legend = legend_of(coloring(packing, "diameter"), (900, 900))
    left, right = legend.tiles[0, 0], legend.tiles[-1, 2]
    places = [x for _, x, _, side in legend.labels if side == "middle"]
    np.testing.assert_allclose(places, left + (marks - low) / (high - low) * (right - left))
    picture = picture_packing(packing, window=WINDOW)
    strip = picture[-round(legend_of(coloring(packing, "diameter"), WINDOW).height * 300) :]
    for end in ENDS:
        assert (np.abs(strip.astype(float) - end).max(axis=2) < 4).any()
    assert not any(float(text) % 1 for text in texts(packing, "coordination")[:-1])


def test_one_value_is_one_entry_also_where_it_is_rounded():
    assert legend_of(Coloring(np.ones(3), "size", "mm"), (900, 900)).labels[0][0] == "1"
    rounded = Coloring(np.array([0.3, 0.1 + 0.2]), "size")
    assert list(rounded.entries.values()) == ["0.3"]
    assert rounded.limits[0] < 0.3 < rounded.limits[1]
    assert legend_of(Coloring(np.zeros(0), "size"), (900, 900)) is None


def test_more_values_than_can_be_listed_have_a_bar():
    for count in (ENTRIES, ENTRIES + 1):
        values = np.arange(count, dtype=float)
        legend = legend_of(Coloring(values, "number", names={v: f"rock {v:g}" for v in values}), (900, 900))
        assert (len(legend.tiles) == count) == (count == ENTRIES)


@pytest.mark.parametrize("window", [(900, 900), (1200, 500), (300, 700), (320, 240)])
@pytest.mark.parametrize("name", ["rock", "a name of a rock that is far too long for any picture of a packing"])
def test_a_legend_stays_within_its_strip(window, name):
    values = np.arange(4.0)
    colors = Coloring(values, "distance from the nearest centroid", "mm", {v: f"{v:g}: {name}" for v in values})
    for shown in (colors, Coloring(values * 12345.678, "largest contact force", "weights of a median grain")):
        legend, size = legend_of(shown, window), text_size(window)
        if legend is None:
            assert min(window) < 300
            continue
        for text, x, y, side in legend.labels:
            wide = text_width(text, size)
            begin = x - wide / 2 if side == "middle" else x
            assert 0.2 * window[0] < begin
            assert begin + wide <= window[0]
            assert 0 <= y <= legend.height * window[1] - size
        assert legend.tiles[:, 0].min() >= LEFT * window[0] - 1e-9
        assert legend.tiles[:, 2].max() <= RIGHT * window[0]
    assert legend_of(colors, (64, 64)) is None


def test_the_packing_stands_above_its_legend(two):
    legend = legend_of(coloring(two, "density"), WINDOW)
    picture = picture_packing(two, color_by="density", window=WINDOW)
    ground = np.abs(picture.astype(int) - picture[0, 0]).max(axis=2) <= 8
    row = round((1 - legend.height) * 300)
    # one line of background between the container and the strip
    assert ground[row - 3 : row - 1].all()
    assert not ground[: row - 8].all()


def test_the_page_of_two_densities_has_their_segregation_and_the_mass_density_along_gravity():
    sphere, where = vg.make_shape("sphere"), [(1, 1, 0.5), (3, 1, 0.5), (1, 1, 1.5), (3, 1, 1.5)]
    box = vg.Box((4, 4, 4))
    bed = vg.Packing.of([sphere] * 2, box, position=where, shape_id=[0, 0, 1, 1], density=(7800, 2500), gravity="-z")
    tree = vg.measure(bed, ["segregation", "profile"])
    found = {fact.label: fact for fact in headline(bed, tree, None)}
    assert found["density segregation"].value == "\u22121.00"
    assert "below 0 where heavy grains lie below" in found["density segregation"].note
    assert [name for _, name in curves_of(bed, tree) if "mass" in name] == ["mass_density_z"]
    drawn = {figure.name: figure for figure in figures_of(bed, tree)}
    assert "mass density, in the unit given" in drawn["mass_density_z"].svg
    same = replace(bed, density=2500.0)
    tree = vg.measure(same, ["segregation", "profile"])
    assert "density segregation" not in [fact.label for fact in headline(same, tree, None)]
    assert not any("mass" in name for _, name in curves_of(same, tree))


def test_labels_are_written_anew_where_the_scene_is_another_one(two):
    written = []
    with stage_of(WINDOW) as stage:
        add_container(stage, two.container)
        keep_written(stage, lambda: (written.append(1), add_scale_bar(stage, "mm")))
        for change, anew in (
            (lambda: None, True),
            (lambda: None, False),
            (lambda: stage.add_mesh(two.to_pyvista()), True),
            (lambda: setattr(stage.camera, "parallel_scale", 2.0), True),
            (lambda: stage.clear_actors(), True),
        ):
            before = len(written)
            change()
            shot(stage)
            assert (len(written) > before) == anew
        assert sum(hasattr(actor, "GetInput") for actor in stage.actors.values()) == 1
