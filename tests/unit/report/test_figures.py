"""Figures and the numbers behind them: sizes asked against placed, the wall, normals, form."""

import json
import math
import shutil
import subprocess

import kit
import numpy as np
import pytest
import scipy.stats
from matplotlib.figure import Figure

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.report import plots
from voxgran.report.figures import figures_of, size_test
from voxgran.report.shape_plots import normal_rose
from voxgran.report.wall_law import law_applies, wall_law
from voxgran.shapes.tessellate import sphere

pytestmark = [pytest.mark.filterwarnings("ignore:the bulk holds"), pytest.mark.usefixtures("jagged_pictures")]


def of_sizes(sizes, asked):
    position = np.column_stack([np.arange(len(sizes)) * 5.0 + 3, np.full((len(sizes), 2), 3.0)])
    return vg.Packing.of(
        [vg.make_shape("sphere")],
        vg.Box((5.0 * len(sizes) + 3, 6, 6)),
        position=position,
        scale=sizes,
        asked_sizes=asked,
    )


def test_the_test_of_sizes_has_the_basis_of_the_curve():
    """Of a thousand small grains and no large one the share by number is right, that by volume is not."""
    asked = vg.sizes.discrete([1.0, 10.0], [0.999, 0.001])
    found = size_test(of_sizes(np.ones(40), asked))
    assert found["basis"] == "volume"
    assert found["distance"] == pytest.approx(1 / (1 + 0.999), rel=1e-9)
    # 40 draws have no large grain with a probability of 0.96
    assert found["p_value"] > 0.9
    packing = of_sizes(np.ones(40), asked)
    figure = next(figure for figure in figures_of(packing, None) if figure.name == "gradation")
    assert "by volume (Kolmogorov\u2013Smirnov), is 0.5" in figure.caption
    assert float(vg.measure(packing, "gradation")["/gradation"].distance_volume) == found["distance"]


@pytest.mark.slow
def test_the_probabilities_of_sizes_as_requested_are_uniform():
    asked = vg.sizes.lognormal(1.0, 0.5)
    values = [size_test(of_sizes(asked.sample(25, stream(seed, "sizes")), asked))["p_value"] for seed in range(30)]
    assert scipy.stats.kstest(values, scipy.stats.uniform.cdf).pvalue > 0.05
    other = vg.sizes.lognormal(4.0, 0.5).sample(60, stream(1, "sizes"))
    assert size_test(of_sizes(other, asked))["p_value"] < 0.01


def test_single_sizes_that_were_placed_as_asked_have_no_distance():
    asked = vg.sizes.discrete([1.0, 2.0], [0.5, 0.5])
    assert size_test(of_sizes(np.array([1.0, 2.0, 1.0, 2.0]), asked))["distance"] == pytest.approx(0.0, abs=1e-12)
    assert size_test(of_sizes(np.array([1.0, 1.0, 1.0, 2.0]), asked))["distance"] == pytest.approx(8 / 9 - 8 / 11)
    assert size_test(vg.Packing.of([vg.make_shape("sphere")], vg.Box((3, 3, 3)), position=[(1, 1, 1)])) is None


def test_requested_curves_reach_all_their_sizes():
    """Also those that no grain has."""
    asked = vg.sizes.lognormal(1.0, 0.8)
    packing = of_sizes(np.full(12, 0.9), asked)
    axes = Figure().add_subplot()
    plots.plot_gradation(axes, packing)
    curve = next(line for line in axes.lines if "requested" in line.get_label()).get_ydata()
    assert curve[0] < 0.2
    assert curve[-1] > 99.8
    table = vg.measure(packing, "gradation")["/gradation"]
    for values in (table["asked_volume"].values, table["placed_volume"].values):
        assert values[0] < 2e-3
        assert values[-1] > 1 - 2e-3


def test_the_law_of_the_wall():
    assert wall_law([0.0], bulk=0.6)[0] == pytest.approx(0.0)
    assert wall_law([0.5], bulk=0.6)[0] == pytest.approx(1 - (2.14 * 0.25 - 2.53 * 0.5 + 1))
    assert wall_law([20.0], bulk=0.6)[0] == pytest.approx(0.6, abs=1e-4)
    x = np.linspace(0.7, 4, 400)
    peaks = x[1:-1][np.diff(np.sign(np.diff(wall_law(x, bulk=0.6)))) < 0]
    assert np.diff(peaks) == pytest.approx(2 / 2.3, abs=0.05)


def test_the_law_is_shown_only_where_it_applies():
    sphere, rock = vg.make_shape("sphere"), vg.make_shape("cone")
    inside = [(0, 0, 1), (1, 0, 1), (0, 1.2, 1)]
    drum = vg.Cylinder(3, 4)
    assert law_applies(vg.Packing.of([sphere], drum, position=inside))
    assert not law_applies(vg.Packing.of([rock], drum, position=inside))
    assert not law_applies(vg.Packing.of([sphere], drum, position=inside, scale=[1, 1.1, 0.9]))
    assert not law_applies(vg.Packing.of([sphere], vg.Box((3, 3, 3)), position=[(1, 1, 1), (2, 2, 2)]))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_rose_of_normals_without_direction_is_round(dimension):
    way = stream(1, "rose").normal(size=(200_000, 3))
    way[:, 2] *= dimension == 3
    angle, share = normal_rose(way / np.linalg.norm(way, axis=1, keepdims=True), dimension=dimension, down=2)
    assert share == pytest.approx(1.0, abs=0.06)
    assert len(angle) == 18
    assert angle[0] == pytest.approx(np.pi / 36)


def test_upright_normals_point_up_and_down():
    angle, share = normal_rose([[0, 0, 1.0], [0, 0, -1.0]], dimension=3, down=2)
    assert np.flatnonzero(share).tolist() == [0, len(angle) - 1]
    _, flat = normal_rose([[0, 1.0, 0]], dimension=2, down=None)
    assert np.flatnonzero(flat).tolist() in ([8], [9])


def test_form_is_that_of_the_smallest_box():
    box = vg.make_shape("box", lengths=(4, 2, 1))
    turned = random_rotations(stream(1, "form"), 1)[0]
    packing = vg.Packing.of([box.rotated(turned)], vg.Box((9, 9, 9)), position=[(4, 4, 4)])
    numbers = {figure.name: figure.numbers for figure in figures_of(packing, None)}
    assert numbers["zingg"] == pytest.approx({"mean_elongation": 0.5, "mean_flatness": 0.5})
    ratio = math.pi ** (1 / 3) * 48 ** (2 / 3) / 28
    assert numbers["roundness"] == pytest.approx({"mean_sphericity": ratio, "mean_roundness": 0.0})
    flat = vg.Packing.of([vg.make_shape("disk")], vg.Rectangle((9, 9)), position=[(4, 4, 0)])
    assert {"zingg", "roundness"} & {figure.name for figure in figures_of(flat, None)} == {"roundness"}


def test_grains_without_a_roundness_are_left_out_and_the_caption_says_so():
    # a spheroid of 80 triangles is too coarse, a box is not
    points, faces, _ = sphere(1)
    shapes = [vg.Shape.from_mesh(points * [1, 1, 2], faces, name="coarse"), vg.make_shape("box")]
    packing = vg.Packing.of(
        shapes, vg.Box((30, 9, 9)), position=[(5, 5, 5), (15, 5, 5), (25, 5, 5)], shape_id=[0, 1, 0]
    )
    with pytest.warns(vg.PackingWarning, match="roundness of 'coarse' is NaN"):
        figure = {figure.name: figure for figure in figures_of(packing, None)}["roundness"]
    assert figure.numbers == pytest.approx({"mean_sphericity": (math.pi / 6) ** (1 / 3), "mean_roundness": 0.0})
    assert "2 of 3 grains are left out: open surfaces, or meshes too coarse to have a curvature." in figure.caption


def lattice():
    ticks = np.arange(5) + 0.5
    position = np.array(np.meshgrid(ticks, ticks, ticks)).reshape(3, -1).T
    return vg.Packing.of([vg.make_shape("sphere")], vg.Box((5, 5, 5), "xyz"), position=position, unit="mm")


def test_the_page_has_a_twin_of_all_numbers(tmp_path):
    packing = lattice()
    tree, proof = vg.measure(packing), vg.verify(packing)
    vg.save_report(packing, tmp_path / "page.html", statistics=tree, verification=proof, pictures=False)
    twin = json.loads((tmp_path / "page.json").read_text())
    assert twin["count"] == 125
    assert twin["statistics"]["solid_fraction"]["value"] == float(tree["solid_fraction"])
    assert twin["verification"]["ok"] is True
    names = [figure.name for figure in figures_of(packing, tree)]
    assert sorted(twin["figures"]) == sorted(names)
    assert twin["figures"]["contact_normals"]["contacts"] == 375
    assert "NaN" not in (tmp_path / "page.json").read_text()
    with pytest.raises(vg.VoxgranError, match=r"page\.html is there already"):
        vg.save_report(packing, tmp_path / "page.html", pictures=False)


@pytest.mark.browser
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_a_browser_finds_nothing_wrong_and_nothing_too_wide(tmp_path):
    packing = lattice()
    page = tmp_path / "page.html"
    found = {"statistics": vg.measure(packing), "verification": vg.verify(packing)}
    # tests/browser opens pages with their interactive view
    vg.save_report(packing, page, **found, turntable=True, interactive=False)
    assert page.stat().st_size < 5e6
    probe = tmp_path / "probe.html"
    probe.write_text(
        f'<iframe id="f" src="{page.as_uri()}" style="width:400px;height:9000px;border:0"></iframe><pre id="out"></pre>'
        "<script>f.onload=()=>{const d=f.contentDocument.documentElement;"
        "out.textContent=d.scrollWidth+' '+d.clientWidth}</script>"
    )
    seen = subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files",
         "--enable-logging=stderr", "--virtual-time-budget=5000", "--dump-dom", probe.as_uri()],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert "CONSOLE" not in seen.stderr
    wide, room = (int(word) for word in seen.stdout.rpartition('<pre id="out">')[2].partition("<")[0].split())
    assert wide <= room == 400


def test_figures_of_contact_numbers_and_of_fabric():
    packing = lattice()
    found = {figure.name: figure for figure in figures_of(packing, vg.measure(packing, ["coordination", "fabric"]))}
    assert found["contact_numbers"].numbers["probability"] == [0.0] * 6 + [1.0]
    drawn = found["contact_normals_map"]
    assert drawn.numbers["vectors"] == 375
    assert np.mean(drawn.numbers["relative_density"]) == pytest.approx(1.0)
    assert "equal-area map" in drawn.caption
    assert "density / isotropic" in drawn.svg
    assert "long_axes_map" not in found
    position = np.pad(np.argwhere(np.ones((5, 5))) + 0.5, ((0, 0), (0, 1)))
    flat = vg.Packing.of([vg.make_shape("disk")], vg.Rectangle((5, 5), "xy"), position=position)
    names = [figure.name for figure in figures_of(flat, vg.measure(flat))]
    assert names.count("contact_normals") == 1
    rose = next(figure for figure in figures_of(flat, vg.measure(flat)) if figure.name == "contact_normals")
    assert rose.numbers["contacts"] == 50
    assert np.flatnonzero(rose.numbers["relative_density"]).tolist() == [0, 9]
    # without the measure the rose is that of the contacts
    plain = next(
        figure for figure in figures_of(flat, vg.measure(flat, "contacts")) if figure.name == "contact_normals"
    )
    assert "anisotropy" not in plain.numbers


def test_a_single_grain_has_no_map():
    one = vg.Packing.of([vg.make_shape("sphere")], vg.Box((3, 3, 3)), position=[(1, 1, 1)])
    names = {figure.name for figure in figures_of(one, vg.measure(one, ["coordination", "fabric"]))}
    assert "contact_numbers" in names
    assert not {"contact_normals", "contact_normals_map"} & names


def test_estimates_are_drawn_with_their_errors():
    box = vg.Box((8, 8, 8), periodic="xyz")
    packing = vg.Packing.of([vg.make_shape("sphere")], box, position=kit.lattice(8, 8, 8) + 0.2)
    found = {figure.name: figure for figure in figures_of(packing, vg.measure(packing, ["rdf", "homogeneity"]))}
    assert {"radial_distribution", "structure_factor", "window_deviation"} <= set(found)
    assert "g(r)" in found["radial_distribution"].svg
    assert "wave number times mean diameter" in found["structure_factor"].svg
    assert len(found["radial_distribution"].numbers["pair_distance"]) == 80
    axes = Figure().add_subplot()
    plots.plot_estimate(axes, [1, 2, 3], [0.1, 0.0, 0.01], label="size", name="deviation", error=0.02, logarithmic=True)
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert np.isnan(axes.lines[0].get_ydata()).tolist() == [False, True, False]
    # the band of the last value would reach below 0
    assert axes.collections[0].get_paths()[0].vertices[:, 1].min() > 0
    plots.plot_estimate(axes := Figure().add_subplot(), [0, 1], [1, np.nan], label="r (mm)", name="g(r)", level=1.0)
    assert axes.get_xlabel() == "r (mm)"
    assert len(axes.lines) == 2
