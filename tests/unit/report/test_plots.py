"""Plots hold the numbers that they are given."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from voxgran._base.errors import InputError
from voxgran.measures.directions import rose_of
from voxgran.packing.model import Packing
from voxgran.report import plots
from voxgran.report.direction_maps import plot_direction_map
from voxgran.report.plots import plot_contact_numbers, plot_coordination, plot_gradation, plot_profile, svg_of
from voxgran.report.shape_plots import plot_rose


@pytest.fixture
def axes():
    return Figure().add_subplot()


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_the_gradation_shows_placed_and_asked(axes, packing):
    assert plot_gradation(axes, packing) is axes
    found = lines(axes)
    assert list(found) == ["placed, equivalent diameter", "placed, intermediate axis", "requested, equivalent diameter"]
    sizes, shares = found["placed, equivalent diameter"].get_data()
    for size in np.quantile(packing.diameters, [0.1, 0.5, 0.9]):
        expected = 100 * packing.volumes[packing.diameters <= size].sum() / packing.volumes.sum()
        assert shares[np.searchsorted(sizes, size, side="right") - 1] == pytest.approx(expected)
    assert shares[-1] == pytest.approx(100)
    asked = found["requested, equivalent diameter"]
    x, y = (np.asarray(values) for values in asked.get_data())
    # by volume of a distribution that is uniform by number: (d^4 - low^4) / (high^4 - low^4)
    np.testing.assert_allclose(y, 100 * np.clip((x**4 - 0.5**4) / (0.9**4 - 0.5**4), 0, 1), atol=1e-9)
    assert axes.get_xlabel() == "size (mm)"
    assert axes.get_ylabel() == "passing by volume (%)"


def test_where_no_sizes_were_asked_only_what_was_placed_is_drawn(axes, packing):
    record = packing.provenance
    bare = Packing.of(packing.shapes, packing.container, position=packing.position, provenance=record)
    assert [name for name in lines(plot_gradation(axes, bare)) if "requested" in name] == []
    assert axes.get_xlabel() == "size"


def test_an_empty_gradation_is_an_empty_plot(axes, packing):
    plot_gradation(axes, Packing.of([], packing.container, position=[]))
    assert len(lines(axes)["placed, equivalent diameter"].get_xdata()) == 0


def test_a_profile_has_its_line_its_mean_and_its_units(axes):
    plot_profile(
        axes, [0.5, 1.5, 2.5], [0.6, np.nan, 0.5], name="height", unit="mm", levels={"whole": 0.55, "bulk": np.nan}
    )
    mean, profile = axes.get_lines()
    assert mean.get_label() == "whole: 0.550"
    np.testing.assert_array_equal(profile.get_ydata(), [0.6, np.nan, 0.5])
    assert axes.get_xlabel() == "height (mm)"
    assert axes.get_ylim()[0] == 0
    assert axes.collections[:] == []
    plot_profile(axes, [0.5, 1.5, 2.5], [0.6, 0.5, 0.5], name="height", unit="mm", error=[0.1, 0.0, 0.1])
    assert axes.collections[0].get_paths()[0].vertices[:, 1].max() == pytest.approx(0.7)
    with pytest.raises(InputError, match="place"):
        plot_profile(axes, [0.5, np.nan], [1, 1], name="height", unit="mm")


def test_coordination_begins_at_the_gap_zero(axes):
    plot_coordination(axes, [0.0, 1e-3, 1e-2], [1.0, 3.0, 5.0], unit="mean diameters")
    np.testing.assert_array_equal(axes.get_lines()[0].get_xdata(), [0.0, 1e-3, 1e-2])
    assert axes.get_xlabel() == "gap (mean diameters)"
    assert axes.get_ylim()[0] == 0
    with pytest.raises(InputError, match="coordination_number"):
        plot_coordination(axes, [0.0, 1.0], [1.0], unit="")


def test_an_svg_stands_alone_repeats_and_takes_the_colour_of_the_text(packing):
    first, second = (svg_of(lambda axes: plot_gradation(axes, packing), "one") for _ in range(2))
    assert first == second
    assert first.startswith("<svg")
    assert first.rstrip().endswith("</svg>")
    assert "currentColor" in first
    assert "<style" not in first
    assert not re.search(r'(href|src)="(?!#)', first)
    names = set(re.findall(r'id="([^"]+)"', first))
    assert names
    assert all(name.startswith("one-") for name in names)
    assert set(re.findall(r'href="#([^"]+)"', first)) <= names
    assert set(re.findall(r"url\(#([^)]+)\)", first)) <= names
    assert "equivalent diameter" in first  # texts stay texts


def test_axes_that_are_alone_are_placed_where_the_constrained_layout_has_them():
    places = []
    for way in ("constrained", None):
        figure = Figure(figsize=(5.2, 3.7), layout=way)
        axes = plot_profile(figure.add_subplot(), [0.0, 9.0], [0.0, 0.61], name="height", unit="mm")
        plots.fit(axes) if way is None else figure.get_layout_engine().execute(figure)
        places.append(axes.get_position().bounds)
    np.testing.assert_allclose(places[1], places[0], atol=2e-3)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.05, "0.05"),
        (2000.0, "2000"),
        (1e-6, "10\u207b\u2076"),
        (2e4, "2\u00b710\u2074"),
        (1e10, "10\u00b9\u2070"),
        (1.25e5, "1.25\u00b710\u2075"),
        (-1e-6, "-10\u207b\u2076"),
    ],
)
def test_marks_of_axes(value, text):
    assert plots.mark_of(value) == text


def test_names_cannot_break_out_of_the_svg():
    svg = svg_of(lambda axes: plot_profile(axes, [0, 1], [0, 1], name="<script>", unit="<b>"), "x")
    assert "<script>" not in svg
    assert "&lt;script&gt;" in svg


def test_contact_numbers_are_bars(axes):
    plot_contact_numbers(axes, [0, 1, 2], [0.2, 0.5, 0.3], error=[0.1, 0.1, 0.1])
    assert [bar.get_height() for bar in axes.patches] == [0.2, 0.5, 0.3]
    assert axes.get_ylim()[0] == 0
    assert axes.get_ylim()[1] > 0.6
    with pytest.raises(InputError, match="probability"):
        plot_contact_numbers(axes, [0, 1], [1.0])


def test_a_rose_has_its_errors_and_the_fitted_density():
    axes = Figure().add_subplot(projection="polar")
    angle, share = np.arange(18) * np.pi / 18, np.ones(18)
    plot_rose(axes, angle, share, upright=False, error=np.full(18, 0.4), deviator=[[0.5, 0.0], [0.0, -0.5]])
    fitted = axes.get_lines()[-1]
    turn, density = (np.asarray(values) for values in fitted.get_data())
    assert density == pytest.approx(1 + 0.5 * np.cos(2 * turn))
    assert axes.get_ylim()[1] == pytest.approx(1.15 * 1.5)
    assert len(axes.collections) == 1
    assert sum(bar.get_height() for bar in axes.patches) == pytest.approx(36)


def test_a_map_has_cells_of_equal_area_and_lines_of_the_fitted_density():
    rose = rose_of(np.array([[0.0, 0, 1]]), dimension=3)
    axes = Figure().add_subplot(projection="polar")
    plot_direction_map(
        axes, rose.cells[:, 0], rose.cells[:, 1], rose.density, deviator=np.diag([-0.5, -0.5, 1.0]), pole=2
    )
    bars = axes.patches
    area = [bar.get_width() * ((bar.get_y() + bar.get_height()) ** 2 - bar.get_y() ** 2) / 2 for bar in bars]
    assert area == pytest.approx([np.pi / 81] * 81)
    colors = {tuple(bar.get_facecolor()) for bar in bars}
    assert len(colors) == 2  # the pole, and all others
    assert axes.get_ylim() == (0.0, 1.0)
    assert [label.get_text() for label in axes.get_xticklabels()] == ["+x", "+y", "\u2212x", "\u2212y"]
    contour = next(found for found in axes.collections if hasattr(found, "levels"))
    # around an axis the lines are circles, at which 1 + a P_2(cos t) is the level
    for level, path in zip(contour.levels, contour.get_paths(), strict=True):
        for radius in path.vertices[:, 1]:
            assert 1 + 0.5 * (3 * (1 - radius**2) ** 2 - 1) == pytest.approx(level, abs=0.02)


def test_an_even_map_has_no_lines():
    rose = rose_of(np.zeros((0, 3)), dimension=3)
    axes = Figure().add_subplot(projection="polar")
    plot_direction_map(axes, rose.cells[:, 0], rose.cells[:, 1], np.ones(81), deviator=np.zeros((3, 3)), pole=0)
    assert not [found for found in axes.collections if hasattr(found, "levels")]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["+y", "+z", "\u2212y", "\u2212z"]


def test_a_label_that_has_no_place_is_left_out():
    """The label of a line would stand at its very beginning, where matplotlib 3.11 fails."""
    tensor = [
        [-0.04110899757359107, -0.025692976869077372, -0.03482613577447646],
        [-0.025692976869077372, -0.08273892037609337, 0.015740640923696352],
        [-0.03482613577447646, 0.015740640923696352, 0.12384791794968444],
    ]
    none = np.zeros((0, 2))

    def draw(axes):
        plot_direction_map(axes, none, none, np.zeros(0), deviator=tensor)

    assert svg_of(draw, "map", size=(5.0, 4.2), projection="polar").count("<path") > 5
