"""Distributions of shapes that are learned from a sample, and the grains that they draw."""

import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from benchmarks.grains import twins
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, OutputExistsError
from voxgran._base.seeds import stream
from voxgran.cli import main
from voxgran.shapes.learning import learn
from voxgran.shapes.learning.learn import balanced
from voxgran.shapes.learning.likeness import (
    FINE,
    QUICK,
    comparable,
    distances,
    energy_distance,
    nearest_neighbour_test,
    quick_descriptors,
    signature,
    spacing,
)
from voxgran.shapes.learning.report import novelty
from voxgran.shapes.learning.sample import closed_grains, meshed
from voxgran.shapes.learning.warp import LEAST, Kernel, frame_of, mapped, warped, width_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.repairing.diagnose import refuse_dirty

POLYHEDRA = vg.make_shapes("convex_polyhedron", count=60, points=(14, 26), aspect=(1.3, 1, 0.8))
SIZES = np.exp(stream(0, "sizes").normal(0, 0.4, 60))
MODEL = vg.learn_shapes(POLYHEDRA, SIZES, strength=0.06)


def test_grains_are_closed_convex_and_their_maps_are_those_of_the_donors():
    for grain in MODEL.sample(8, seed=3):
        refuse_dirty(grain.vertices, grain.faces, grain.name)
        assert vg.describe(grain, "convexity").convexity.item() == pytest.approx(1.0, abs=1e-9)
        assert grain.volume > 0
        assert grain.geometry.centroid == pytest.approx(np.zeros(3), abs=1e-12)
        donor = MODEL.shapes[grain.record["donor"]]
        assert mapped(donor.vertices, grain.record["map"]) == pytest.approx(grain.vertices, abs=1e-12)
        # the principal axes are those of the body frame, the longest along x
        moments = np.diag(grain.inertia)
        assert grain.inertia == pytest.approx(np.diag(moments), abs=1e-9 * moments.max())
        assert (np.diff(moments) > -1e-12).all()


def test_half_of_the_grains_are_mirrored():
    turned = [np.linalg.det(grain.record["map"][:3, :3]) < 0 for grain in MODEL.sample(200, seed=1)]
    assert 70 < sum(turned) < 130


def test_a_strength_of_zero_only_stretches():
    mesh = POLYHEDRA[0].geometry
    radius, _, roots, _ = frame_of(mesh)
    own = np.log([roots[1] / roots[0], roots[2] / roots[1], 2 * radius])
    made, matrix = warped(mesh, own, 0.0, stream(1, "warp"))
    # what has the ratios and the size of its donor is the donor, but for turns
    assert matrix[:3, :3] @ matrix[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    marks = np.array([signature(one) for one in (mesh, made)])
    assert distances(marks[:1], marks[1:])[0, 0] == pytest.approx(0.0, abs=1e-6)
    assert made.volume == pytest.approx(mesh.volume, rel=1e-12)


def test_marginals_and_correlations_are_those_of_the_sample():
    # size goes with elongation
    ratio = 0.3 + 0.6 * stream(1, "ratios").random(80)
    shapes = [vg.shapes.box(aspect=(1, q, 0.3), diameter=2 - q) for q in ratio]
    grains = vg.learn_shapes(shapes, strength=0.05).sample(160, seed=2)
    roots = np.array([frame_of(grain.geometry)[2] for grain in grains])
    found, sizes = roots[:, 1] / roots[:, 0], [grain.diameter for grain in grains]
    quarters = (0.1, 0.25, 0.5, 0.75, 0.9)
    assert np.quantile(found, quarters) == pytest.approx(np.quantile(ratio, quarters), abs=0.05)
    assert np.quantile(sizes, quarters) == pytest.approx(np.quantile(2 - ratio, quarters), abs=0.05)
    assert np.corrcoef(found, sizes)[0, 1] < -0.95


def test_modes_stay_apart():
    rows = np.concatenate([stream(0, "a").normal(0, 0.05, (40, 1)), stream(0, "b").normal(3, 0.05, (40, 1))])
    even = np.full(80, 1 / 80)
    kernel, draw = Kernel(rows, even, even), stream(0, "draw")
    drawn = np.array([kernel.draw(int(grain), draw)[0] for grain in kernel.grains(400, draw)])
    assert ((drawn < 0.5) | (drawn > 2.5)).mean() > 0.98
    assert (drawn > 1.5).mean() == pytest.approx(0.5, abs=0.01)


def test_kernels_are_as_wide_as_the_strength_says():
    assert [width_of(strength) for strength in (0.0, 0.005, 0.02, 0.05, 0.08, 0.12)] == [0, 0.25, 1, 1, 1, 1.5]
    rows, even = stream(0, "rows").normal(0, 1, (60, 2)), np.full(60, 1 / 60)
    steps = []
    for width in (0.0, 0.5, 1.0):
        kernel, draw = Kernel(rows, even, even, width), stream(1, "draw")
        steps.append(np.abs(kernel._raw(np.arange(60), draw) - rows).mean())
    assert steps == pytest.approx([0.0, steps[2] / 2, steps[2]])


def test_no_part_of_a_grain_grows_without_bound():
    # a long needle and a taper that would take its tip to infinity
    needle = meshed(vg.shapes.box(lengths=(12, 1, 1.2))).geometry
    radius, _, roots, _ = frame_of(needle)
    own = np.log([roots[1] / roots[0], roots[2] / roots[1], 2 * radius])
    for seed in range(20):
        made, matrix = warped(needle, own, 1.0, stream(seed, "warp"))
        depths = needle.vertices @ matrix[3, :3] + matrix[3, 3]
        assert depths.min() > LEAST - 1e-9
        assert made.volume == pytest.approx(needle.volume, rel=1e-9)


@pytest.mark.parametrize(
    ("worst", "newest", "chosen"),
    [
        (1, 0.065, 0.065),
        (0.04, 1, 0.04),
        (0.05, 0.05, 0.05),
        (0.005, 1, 0.005),
        (0.012, 0, 0.01),
        (1, 0, 0.02),
        (1, 1, 0.12),
    ],
)
def test_the_least_strength_is_chosen_that_makes_new_grains_or_the_largest_without_error(
    monkeypatch, worst, newest, chosen
):
    # grains of strengths from `newest` on are new, and of those above `worst` the error is infinite
    far = [vg.shapes.box(lengths=(9, 1, 1 + k / 9)) for k in range(5)]

    def balancing(even, rows, seed):
        drawn = [meshed(shape) for shape in far] if even.strength >= newest else POLYHEDRA[:5]
        return even.weights, drawn, math.inf if even.strength > worst else 0.0

    monkeypatch.setattr(learn, "_balancing", balancing)
    assert vg.learn_shapes(POLYHEDRA[:40]).strength == chosen


def test_weights_say_how_often_a_grain_is_the_donor():
    weights = np.where(np.arange(60) < 30, 3.0, 1.0)
    grains = vg.learn_shapes(POLYHEDRA, strength=0.05, weights=weights).sample(400, seed=1)
    assert np.mean([grain.record["donor"] < 30 for grain in grains]) == pytest.approx(0.75, abs=0.06)


def test_weights_of_donors_make_up_for_the_mean_change():
    draw = stream(3, "balance")
    given, weights = draw.normal(0, 1, (400, 2)), draw.uniform(0.5, 1.5, 400)
    weights /= weights.sum()
    donors = np.arange(400)
    # each grain loses half a standard deviation of the second descriptor
    found = balanced(given, weights, given - [0.0, 0.5], donors)
    assert found @ (given - [0.0, 0.5]) == pytest.approx(weights @ given, abs=0.02)
    assert found.sum() == pytest.approx(1.0)
    # of normal rows the weights nearest by entropy are exp(row / 2), by the closed formula
    tilt = np.log(found / weights)
    assert np.polyfit(given[:, 1], tilt, 1)[0] == pytest.approx(0.5 / given[:, 1].std() ** 2, rel=0.1)
    assert balanced(given, weights, given, donors) == pytest.approx(weights, rel=1e-6)
    # what no weights make up for leaves no grain as the donor of most
    assert balanced(given, weights, given - [0.0, 50.0], donors).max() < 0.2


def test_corners_of_drawn_grains_stick_out_little_more_than_those_of_the_sample():
    # strong shears alone move corners outwards, by 0.04 and 0.03 diameters
    model = vg.learn_shapes(POLYHEDRA, strength=0.2)
    even = replace(model, donors=model.weights)
    columns = [QUICK.index("farthest_corner"), QUICK.index("largest_distance")]
    own, found, alone = (
        quick_descriptors(grains)[:, columns].mean(axis=0)
        for grains in (POLYHEDRA, model.sample(150, seed=4), even.sample(150, seed=4))
    )
    assert (found - own < 0.75 * (alone - own)).all()


@pytest.mark.slow
def test_rounded_grains_stay_as_round_as_those_of_the_sample():
    # shears alone make bumps sharper: by half the standard deviation of roundness at this strength
    model = vg.learn_shapes(vg.make_shapes("mollon_zhao", count=24, subdivisions=3), strength=0.05)
    own, even = quick_descriptors(model.shapes)[:, 4], replace(model, donors=model.weights)
    found = [quick_descriptors(one.sample(60, seed=4))[:, 4].mean() for one in (model, even)]
    assert abs(found[0] - own.mean()) < 0.5 * abs(found[1] - own.mean())


def test_energy_distance_and_neighbours_have_their_closed_values():
    # of a point and two points at distances 1 and 2: 2 (1.5) - 0 - 0.5
    one, two = np.array([[0.0]]), np.array([[1.0], [2.0]])
    assert energy_distance(one, two, np.ones(1)) == pytest.approx(2.5)
    assert energy_distance(two, one, np.ones(1), np.array([1.0, 3.0])) == pytest.approx(2 * 1.75 - 2 * 3 / 16)
    assert energy_distance(one, two, np.ones(1), others=np.array([1.0, 3.0])) == pytest.approx(2 * 1.75 - 2 * 3 / 16)
    marks = np.array([signature(meshed(shape).geometry) for shape in POLYHEDRA])
    share, p_value = nearest_neighbour_test(marks[:30], marks[30:], stream(0, "test"))
    assert share < 0.65
    assert p_value > 0.05
    rods = np.array([signature(meshed(vg.shapes.box(lengths=(4, 1, 1 + k / 50))).geometry) for k in range(30)])
    share, p_value = nearest_neighbour_test(marks[:30], rods, stream(0, "test"))
    assert (share, p_value) == (1.0, pytest.approx(0.001))


def test_novelty_is_a_ratio_of_median_distances_to_the_nearest_grain():
    def marks(*lengths: float) -> np.ndarray:
        return np.array([[0.0] * FINE**3 + [x] * 3 for x in lengths])

    given = marks(0, 1, 3)
    # nearest given grains of the drawn ones: 0.25, 0.5 and 0.5; of each other: 1, 1 and 2; of new ones: 0.5, 1 and 2
    drawn = marks(0.25, 0.5, 2.5)
    assert novelty(drawn, given, None) == pytest.approx(0.5)
    assert novelty(drawn, given, marks(0.5, 5, 4)) == pytest.approx(0.5)
    assert novelty(drawn, given, marks(0.5, -2, 5)) == pytest.approx(0.25)


@pytest.mark.parametrize("order", list(itertools.permutations(range(3)))[1:])
def test_turned_and_mirrored_copies_are_no_new_grains(order):
    points = POLYHEDRA[3].vertices
    for sides in itertools.product((1, -1), repeat=3):
        matrix = np.eye(3)[list(order)] * sides
        faces = POLYHEDRA[3].faces if np.linalg.det(matrix) > 0 else POLYHEDRA[3].faces[:, ::-1]
        marks = [signature(Mesh(*one)) for one in ((points, POLYHEDRA[3].faces), (points @ matrix.T, faces))]
        assert distances(np.array(marks[:1]), np.array(marks[1:]))[0, 0] < 1e-6


def test_distances_take_axes_in_any_order():
    mark = signature(POLYHEDRA[3].geometry)
    number = len(mark) - 3
    side = round(number ** (1 / 3))
    field = mark[:number].reshape(side, side, side)
    other = np.concatenate([field.transpose(2, 0, 1)[::-1].ravel(), mark[number:][[2, 0, 1]]])
    assert distances(mark[None], other[None])[0, 0] == pytest.approx(0.0, abs=1e-7)


def test_descriptors_that_grains_lack_are_left_out():
    one, two = np.ones((20, 2)), np.zeros((20, 2))
    one[:3, 1] = two[0, 0] = np.nan
    (first, second), kept = comparable(one, two)
    assert kept.tolist() == [True, False]
    assert first.shape == (20, 1)
    assert second[0, 0] == 1.0  # the median of all


def test_files_hold_the_model(tmp_path):
    MODEL.save(tmp_path / "shapes.nc")
    read = vg.ShapeModel.load(tmp_path / "shapes.nc")
    assert read.sample(5, seed=4) == MODEL.sample(5, seed=4)
    assert (read.strength, read.method, read.unit) == (MODEL.strength, "warp", None)
    with pytest.raises(OutputExistsError):
        MODEL.save(tmp_path / "shapes.nc")
    made = vg.make_shapes("learned", count=3, model=str(tmp_path / "shapes.nc"))
    assert made == vg.make_shapes("learned", count=3, model=MODEL)
    assert vg.shapes.learned(model=MODEL, diameter=2.0).diameter == pytest.approx(2.0)
    scene = {"scene": {"seed": 1}, "shape": [{"model": "shapes.nc"}], "packing": {"method": "rsa", "count": 5}}
    scene["container"] = {"kind": "box", "lengths": [12, 12, 12]}
    assert len(vg.Scene.from_mapping(scene, folder=tmp_path).shapes[0].make()) == 50


def test_the_command_learns_and_reports(tmp_path, capsys):
    vg.save(vg.pack(POLYHEDRA[:12], vg.Box((12, 12, 12)), "rsa", count=12), tmp_path / "bed.vtp")
    assert main(["learn", str(tmp_path / "bed.vtp"), "-o", str(tmp_path / "shapes.nc"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["grains"], told["strength"]) == (12, 0.05)
    assert 0 < told["energy_distance"] < 1
    assert len(vg.ShapeModel.load(tmp_path / "shapes.nc").shapes) == 12


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "shapes.nc"
    MODEL.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileFormatError, match=r"shapes\.nc"):
        vg.ShapeModel.load(path)
    path.write_bytes(b"no netCDF")
    with pytest.raises(FileFormatError, match=r"shapes\.nc"):
        vg.ShapeModel.load(path)
    bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=3)
    vg.save_statistics(vg.measure(bed, "coordination"), tmp_path / "s.nc")
    with pytest.raises(FileFormatError, match="no distribution of shapes"):
        vg.ShapeModel.load(tmp_path / "s.nc")
    with pytest.raises(MissingFileError):
        vg.make_shape("learned", model=str(tmp_path / "none.nc"))


def copies(shape, count=12):
    """Return a solid in several sizes, turned, and every other one mirrored."""
    turns, made = stream(0, "turns").normal(size=(count, 3, 3)), []
    for k in range(count):
        matrix = np.linalg.qr(turns[k])[0] * (1 + k / 7)
        faces = shape.faces if np.linalg.det(matrix) > 0 else np.array(shape.faces)[:, ::-1]
        made.append(vg.Shape.from_mesh(shape.vertices @ matrix.T, faces))
    return made


BAD = [
    (copies(POLYHEDRA[0]), {}, "12 times one shape, of whatever size, turned or mirrored"),
    (copies(vg.make_shape("solid_union")), {}, "12 times one shape"),
    ([vg.shapes.ellipsoid(diameter=1 + k / 9) for k in range(12)], {}, "12 times one shape"),
    (POLYHEDRA[:9], {}, "shapes has 9 whole grains: at least 10 are needed"),
    ([POLYHEDRA[0]] * 12, {}, "12 times one shape"),
    ([*POLYHEDRA[:10], vg.shapes.shell()], {}, "open surface"),
    ([*POLYHEDRA[:10], vg.shapes.disk()], {}, "plane"),
    ([*POLYHEDRA[:10], POLYHEDRA[1].to_unit("mm"), POLYHEDRA[2].to_unit("m")], {}, "units m, mm"),
    (POLYHEDRA, {"method": "copula"}, "method is 'copula': it must be one of warp"),
    (POLYHEDRA, {"strength": 0.5}, "strength is 0.5"),
    (POLYHEDRA, {"sizes": np.zeros(60)}, "sizes has 0: all must be above 0"),
    (POLYHEDRA, {"weights": [1.0]}, "weights"),
    (3, {}, "shapes is 3: it must be a list of shapes or a packing"),
]


@pytest.mark.parametrize(("shapes", "given", "message"), BAD)
def test_bad_samples_are_refused_in_one_sentence(shapes, given, message):
    with pytest.raises(InputError, match=message):
        vg.learn_shapes(shapes, **given)


@pytest.mark.parametrize("draw", [MODEL.sample, lambda count: MODEL.report(count=count)])
def test_more_grains_than_the_memory_holds_are_refused(draw):
    with pytest.raises(InputError, match="count is 1000000000: it must be at most 1000000; give less"):
        draw(10**9)


def test_one_other_shape_makes_a_distribution():
    assert len(vg.learn_shapes([*copies(POLYHEDRA[0]), POLYHEDRA[1]], strength=0.05).shapes) == 13


def scan(count: int, seed: int, size: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Return labels of spheres of two radii, cut by the border, and the radius of each."""
    draw = stream(seed, "scan")
    image, radii, centers = np.zeros((size,) * 3, dtype=np.int64), np.zeros(count + 1), np.zeros((count + 1, 3))
    grid = np.stack(np.indices(image.shape), axis=-1) + 0.5
    made = 0
    while made < count:
        center, radius = draw.uniform(-8, size + 8, 3), (4.0, 8.0)[int(draw.integers(2))]
        if made and (np.linalg.norm(centers[1 : made + 1] - center, axis=1) < radii[1 : made + 1] + radius + 1.5).any():
            continue
        made += 1
        radii[made], centers[made] = radius, center
        image[((grid - center) ** 2).sum(axis=-1) < radius**2] = made
    return image, radii


@pytest.mark.slow
def test_grains_that_the_border_cuts_are_weighted():
    # half of the spheres are large; of the whole ones within the image fewer are
    packing = vg.packing_of_labels(scan(70, 1)[0], voxel_size=1.0, gravity="none")
    whole, weights = closed_grains(packing)
    large = packing.diameters[whole] > 12
    expected = 1 / (1 - np.where(large, 16, 8) / 64) ** 3
    assert weights == pytest.approx(expected / expected.sum(), rel=0.08)
    lower, upper = packing.container.bounds
    for grain in set(range(packing.count)) - set(whole.tolist()):
        corners = packing.world_vertices(grain)
        assert min((corners - lower).min(), (upper - corners).min()) < 0.5
    model = vg.learn_shapes(packing)
    assert len(model.shapes) == len(whole) < packing.count
    assert model.weights == pytest.approx(weights)


def test_labels_without_a_whole_grain_are_refused():
    image = np.zeros((20, 20, 20), dtype=int)
    image[:, :9], image[:, 11:] = 1, 2
    with pytest.raises(InputError, match="2 grains, all of which the border of the image cuts"):
        vg.learn_shapes(vg.packing_of_labels(image, voxel_size=1.0, gravity="none"))


def test_the_prompt_and_scenes_refuse_bad_samples_in_one_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k, shape in enumerate([*POLYHEDRA[:9], vg.shapes.shell()]):
        vg.save_shape(shape, f"{k}.stl")
    one = vg.pack(POLYHEDRA[:1], vg.Box((20, 20, 20)), "rsa", count=12)
    vg.save(one, "one.vtp")
    vg.learn_shapes(POLYHEDRA[:10]).save("bad.nc")
    (tmp_path / "one.csv").write_text("x,y,z")
    image = np.zeros((20, 20, 20), dtype=int)
    image[:, :9], image[:, 11:] = 1, 2
    vg.save(vg.packing_of_labels(image, voxel_size=1.0, gravity="none"), "cut.vtp")
    bad = {
        ("cut.vtp",): "the packing has 2 grains, all of which the border of the image cuts",
        tuple(f"{k}.stl" for k in range(9)): "shapes has 9 whole grains: at least 10 are needed; give more",
        ("one.vtp",): "shapes is 12 times one shape",
        ("0.stl", "9.stl"): "a grain must be a closed surface; run voxgran repair on it",
        ("cut.vtp", "one.vtp"): "cut.vtp is a packing, one of 2 files",
        ("0.stl", "none.txt"): "none.txt is not there",
        ("0.stl", "1.stl", "one.csv"): "one.csv, line 1: 'x y z' does not name the columns",
        ("none.vtp", "one.vtp"): "none.vtp is not there",
        ("bad.nc",): "bad.nc holds numbers and no packing: vg.load_statistics or vg.ShapeModel.load reads them",
    }
    for files, message in bad.items():
        assert main(["learn", *files, "-o", "shapes.nc"]) == 2
        told = capsys.readouterr().err
        assert message in told
        assert told.count("\n") == 1
    container = {"kind": "box", "lengths": [12, 12, 12]}
    scene = {"container": container, "shape": [{"model": "one.vtp"}], "packing": {"method": "rsa", "count": 5}}
    with pytest.raises(
        FileFormatError, match=r"one\.vtp has the suffix '\.vtp': distributions of shapes are kept as \.nc"
    ):
        vg.Scene.from_mapping(scene).shapes[0].make()


def test_the_error_of_the_sample_is_that_of_its_weights():
    model = vg.learn_shapes(POLYHEDRA[:20])
    heavy = replace(model, weights=np.array([0.9] + [0.1 / 19] * 19))
    even, uneven = (float(one.report(count=10, descriptors=False).table.sample_error) for one in (model, heavy))
    assert uneven > 2 * even


NUMBERS = ["energy_distance", "sample_error", "novelty"]


@pytest.mark.slow
@pytest.mark.parametrize("case", ["voronoi_fragment", "rings_with_rods"])
def test_drawn_grains_are_as_near_to_others_as_the_sample_is(case):
    # one sample of 40 scatters: means over three
    models = [vg.learn_shapes(twins.CASES[case](40, seed), strength=0.05) for seed in (5, 6, 7)]
    reports = [model.report(twins.CASES[case](60, 8), count=60, descriptors=False) for model in models]
    error, own, new = np.mean([list(map(float, report.table[NUMBERS].values())) for report in reports], axis=0)
    assert error < 1.5 * own
    # grains that bend keep the ratios of their donors
    assert new > (0.8 if models[0].method == "warp" else 0.7)
    # the picture shows each donor, then what was made of it
    assert len(reports[0].pairs) == 12
    for donor, grain in zip(reports[0].pairs[::2], reports[0].pairs[1::2], strict=True):
        assert donor == models[0].shapes[grain.record["donor"]]
    assert "energy_distance" in repr(reports[0])
    for grain in reports[0].pairs[1::2]:
        refuse_dirty(grain.vertices, grain.faces, grain.name)


@pytest.mark.slow
def test_the_strength_is_chosen_within_its_range():
    model = vg.learn_shapes(POLYHEDRA[:40])
    assert 0.02 <= model.strength <= 0.12
    assert vg.learn_shapes(POLYHEDRA[:20]).strength == 0.05
    again = model.report(count=20, descriptors=False)
    # halves of 20 grains each differ by more than 40 grains from themselves
    assert 0.02 < float(again.table.sample_error) < 1


def test_copies_of_grains_are_no_neighbours():
    once, copied = POLYHEDRA[:20], [*POLYHEDRA[:20], *(grain.rotated((0.6, 0.8, 0, 0)) for grain in POLYHEDRA[:20])]
    marks, twice = learn.signatures(once), learn.signatures(copied)
    assert spacing(marks) > 0.01
    assert spacing(twice) == pytest.approx(spacing(marks), rel=1e-3)
    assert novelty(marks + 0.1, twice, None) == pytest.approx(novelty(marks + 0.1, marks, None), rel=1e-3)


def test_the_strength_is_refined_where_the_error_ends_the_search(monkeypatch):
    def balancing(even, rows, seed):
        return even.donors, [even.strength], even.strength

    monkeypatch.setattr(learn, "_balancing", balancing)
    monkeypatch.setattr(learn, "signatures", lambda grains: np.array([g if type(g) is float else 1.0 for g in grains]))
    monkeypatch.setattr(learn, "spacing", np.max)
    monkeypatch.setattr(learn, "distances", lambda one, two: np.broadcast_to(one[:, None], (len(one), len(two))).copy())
    # the error is the strength, and may exceed the least one by a quarter of that of halves of the sample: up to 0.048
    monkeypatch.setattr(learn, "energy_distance", lambda *given: 4 * 0.043)
    assert learn._chosen(MODEL, np.zeros((60, 5)), 0) == pytest.approx(0.0475)


@pytest.mark.slow
def test_rows_of_the_bench_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(twins, "CASES", {name: twins.CASES[name] for name in ("ellipsoids", twins.GROWING)})
    for name, value in (
        ("LEARNED", 20),
        ("DRAWN", 20),
        ("TESTED", 20),
        ("NUMBERS", (12,)),
        ("SAMPLES", 2),
        ("MANY", (12, 20)),
        ("LARGE", twins.GROWING),
    ):
        monkeypatch.setattr(twins, name, value)
    table, figure = twins.run(tmp_path)
    assert table.read_text().count("\n") == 6
    assert "<svg" in figure.read_text()
