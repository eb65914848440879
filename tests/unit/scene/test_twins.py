"""Twins of samples: weights of grains that a border cuts, sizes, solid fraction, comparison and page."""

import json

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.measures.border import border_weights, is_scan
from voxgran.scene.twins.differences import TEXTS
from voxgran.scene.twins.sample import sample_of

EQUAL = 2.0


@pytest.fixture(scope="module")
def spheres():
    """Return a specimen of graded spheres."""
    sizes = vg.sizes.lognormal(median=1.0, sigma=0.2)
    box = vg.Box((4, 4, 4), periodic="xyz")
    return vg.pack(vg.shapes.sphere(), box, "expand", count=60, solid_fraction=0.5, sizes=sizes)


@pytest.fixture(scope="module")
def copy(spheres):
    """Return a twin of it."""
    return vg.twin(spheres, count=50, protocol="expand", seed=2)


def scan_of(boxes, side=10):
    """Return a packing of labels of boxes of voxels, each (lower, upper)."""
    image = np.zeros((side,) * 3, dtype=np.int32)
    for k, (lower, upper) in enumerate(boxes):
        image[tuple(slice(a, b) for a, b in zip(lower, upper, strict=True))] = k + 1
    return vg.packing_of_labels(image, voxel_size=1.0, surface="voxel", gravity="none")


def test_weights_are_the_inverse_of_the_room_that_whole_grains_have():
    scan = scan_of([((0, 0, 0), (3, 3, 3)), ((4, 4, 3), (6, 7, 8)), ((8, 8, 8), (10, 10, 10))])
    assert is_scan(scan)
    assert border_weights(scan) == pytest.approx([0.0, 1 / (0.8 * 0.7 * 0.5), 0.0])


def test_along_a_periodic_axis_nothing_is_cut():
    image = np.zeros((10, 10, 10), dtype=np.int32)
    image[0:2, 4:6, 4:6], image[4:6, 0:2, 4:6], image[4:6, 4:8, 7:9] = 1, 2, 3
    scan = vg.packing_of_labels(image, voxel_size=1.0, surface="voxel", gravity="none", periodic="x")
    # on one side along y a grain ends in the border: the grains end it on the other one
    assert border_weights(scan) == pytest.approx([1 / (1 - 2 / 8), 0.0, 1 / (1 - 4 / 8)])


def test_packings_that_no_image_cuts_have_equal_weights(spheres):
    assert not is_scan(spheres)
    assert (border_weights(spheres) == 1.0).all()


@pytest.mark.slow
def test_a_cut_sample_gives_the_sizes_that_were_cut():
    """Of six parts of packings the mean diameter of whole grains is too small by 8 %, by weights it is right."""
    means = []
    for seed in range(6):
        sizes = vg.sizes.lognormal(median=1, sigma=0.4)
        box = vg.Box((9, 9, 9), periodic="xyz")
        bed = vg.pack(vg.shapes.sphere(), box, "rsa", count=220, sizes=sizes, seed=seed)
        scan = vg.packing_of_labels(vg.to_image(bed, 0.1)[15:75, 15:75, 15:75], voxel_size=0.1, gravity="none")
        weights, size = border_weights(scan), scan.diameters
        means.append([bed.diameters.mean(), size[weights > 0].mean(), np.average(size, weights=weights)])
    true, whole, weighted = np.mean(means, axis=0)
    print(f"\nmean diameter: true {true:.3f}, of whole grains {whole:.3f}, weighted {weighted:.3f}")  # noqa: T201
    assert whole < 0.95 * true
    assert weighted == pytest.approx(true, rel=0.03)


def test_sizes_are_laid_over_the_weighted_distribution():
    shapes = [vg.shapes.sphere(diameter=diameter) for diameter in np.linspace(1, 2, 20)]
    sample = sample_of(shapes, 0.6)
    assert sample.laid_sizes(20) == pytest.approx(np.linspace(1, 2, 20))
    assert len(sample.laid_sizes(7)) == 7
    assert np.median(sample.laid_sizes(101)) == pytest.approx(1.5)


def test_a_twin_has_the_solid_fraction_and_sizes_of_its_sample(spheres, copy):
    assert copy.packing.count == 50
    assert copy.packing.solid_fraction == pytest.approx(spheres.solid_fraction, abs=0.002)
    assert np.median(copy.packing.diameters) == pytest.approx(np.median(spheres.diameters), rel=0.01)


def test_the_comparison_holds_each_measure_with_its_scatter(copy):
    data = copy.comparison
    assert set(map(str, data["measure"].values)) <= set(TEXTS)
    row = data.sel(measure="D50")
    assert float(row["difference"]) == pytest.approx(float(row["twin"]) - float(row["sample"]))
    both = np.hypot(float(row["sample_scatter"]), float(row["twin_scatter"]))
    assert float(row["ratio"]) == pytest.approx(float(row["difference"]) / both)
    assert (np.abs(data["ratio"].values) <= EQUAL).mean() > 0.8
    assert float(data["two_point_correlation_sample"][0]) == pytest.approx(0.5, abs=0.01)
    assert float(data["sample"].sel(measure="wetted_surface")) == pytest.approx(
        float((np.pi * copy.sample.packing.diameters**2).sum() / copy.sample.packing.container.volume), rel=0.03
    )


def test_a_difference_is_told_in_units_of_the_scatter(spheres):
    data = vg.twin(spheres, count=50, protocol="expand", solid_fraction=0.35).comparison
    assert float(data["sample"].sel(measure="solid_fraction")) == pytest.approx(0.5, abs=0.002)
    assert float(data["ratio"].sel(measure="solid_fraction")) < -EQUAL
    assert float(data["ratio"].sel(measure="tortuosity")) < -EQUAL


def test_the_page_lists_the_largest_difference_first(copy, tmp_path):
    copy.report(tmp_path / "twin.html")
    text = (tmp_path / "twin.html").read_text()
    assert "solid fraction; 50 grains" in text
    numbers = json.loads((tmp_path / "twin.json").read_text())["numbers"]
    worst = max(numbers, key=lambda row: abs(row["ratio"] or 0.0))
    rows = text.split("<tbody>")[1].split('<th scope="row">')
    assert rows[1].startswith(TEXTS[worst["measure"]][0])


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (lambda: vg.twin([vg.shapes.sphere()], solid_fraction=0.6), "10 at least"),
        (lambda: vg.twin([vg.shapes.sphere()] * 12), "give that of the twin"),
        (lambda: vg.twin([vg.shapes.sphere()] * 12, solid_fraction=0.8), "rigid grains"),
        (lambda: vg.twin([vg.shapes.sphere()] * 12, solid_fraction=0.1), "rigid grains"),
        (lambda: vg.twin(scan_of([((0, 0, 0), (3, 3, 3)), ((5, 5, 5), (10, 9, 9))])), "no whole grain"),
        (lambda: vg.twin([vg.shapes.sphere()] * 12, solid_fraction=0.6, protocol="poured"), "protocol"),
    ],
)
def test_bad_samples_are_refused_in_one_sentence(given, told):
    with pytest.raises(InputError, match=told):
        given()
