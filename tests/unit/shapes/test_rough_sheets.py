"""Open sheets: heights of random fields, and folds that keep all lengths."""

import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, TooLargeError
from voxgran._base.seeds import stream
from voxgran.geometry.crossing import count_crossings
from voxgran.shapes.families.surfaces.crumpled import Folded, folded
from voxgran.shapes.families.surfaces.sheet import lattice_faces
from voxgran.shapes.finer import edges_of


@pytest.mark.parametrize("method", ["spectral", slow("patir"), slow("whitehouse"), "midpoint"])
def test_heights_of_a_rough_sheet(method):
    sheet = vg.make_shape("rough_sheet", method=method, lengths=(4, 3), rms=0.05, correlation_length=0.2)
    heights = sheet.vertices[:, 2] - sheet.vertices[:, 2].mean()
    assert math.sqrt((heights**2).mean()) == pytest.approx(0.05, rel=1e-9)
    assert sheet.record["roughness_rms"] == pytest.approx(0.05, rel=1e-9)
    assert sheet.record["roughness_correlation_length"] == pytest.approx(0.2, rel=0.3)
    lower, upper = sheet.bounds
    assert (upper - lower)[:2] == pytest.approx([4, 3])
    assert sheet.surface_area > 12.0
    # measured above its mean plane, from the triangles alone
    found = vg.surface_statistics(sheet)
    plane = np.column_stack([sheet.vertices[:, :2], np.ones(len(heights))])
    above = heights - plane @ np.linalg.lstsq(plane, heights)[0]
    assert found.rms == pytest.approx(above.std(), rel=0.04)
    assert found.correlation_length == pytest.approx(sheet.record["roughness_correlation_length"], rel=0.25)


def lattice_of(sheet):
    """Return the heights of a rough sheet above its mean plane, and the spacing of its lattice."""
    vertices = sheet.vertices[np.lexsort(sheet.vertices.T[1::-1])]
    plane = np.column_stack([vertices[:, :2], np.ones(len(vertices))])
    above = vertices[:, 2] - plane @ np.linalg.lstsq(plane, vertices[:, 2])[0]
    columns = int(np.isclose(vertices[:, 1], vertices[0, 1]).sum())
    return above.reshape(columns, -1), vertices[1, 1] - vertices[0, 1]


@pytest.mark.parametrize(("method", "end"), [slow("patir", 0.0), slow("spectral", 0.75)])
def test_statistics_of_triangles_are_those_of_their_lattice(method, end, monkeypatch):
    field = {"lengths": (14, 12), "rms": 0.1, "correlation_length": 1.0, "shortest": 0.75, "seed": 3}
    sheet = vg.make_shape("rough_sheet", method=method, **field)
    heights, spacing = lattice_of(sheet)
    lattice, found = vg.surface_statistics(heights, spacing=spacing), vg.surface_statistics(sheet)
    assert found.rms == pytest.approx(lattice.rms, rel=0.01)
    assert found.skewness == pytest.approx(lattice.skewness, abs=0.02)
    assert found.correlation_length == pytest.approx(lattice.correlation_length, rel=0.02)
    assert found.hurst == pytest.approx(lattice.hurst, abs=0.05)
    assert found.correlation_length_error == pytest.approx(lattice.correlation_length_error, rel=0.3)
    assert found.hurst_error == pytest.approx(lattice.hurst_error, rel=0.4)
    # the same in another order, with all vertices or with some of them
    order = stream(1, "order").permutation(len(sheet.vertices))
    place = np.argsort(order)
    other = vg.Shape.from_surface(sheet.vertices[order], place[sheet.faces])
    for some in (20_000, 3_000):
        monkeypatch.setattr("voxgran.shapes.roughness.measuring.MOST_POINTS", some)
        one, two = (vg.surface_statistics(shape, shortest=end) for shape in (sheet, other))
        assert two.correlation_length == pytest.approx(one.correlation_length, rel=1e-6)
        assert two.hurst == pytest.approx(one.hurst, abs=1e-3)
        assert one.correlation_length == pytest.approx(lattice.correlation_length, rel=0.02 if some == 20_000 else 0.05)


@pytest.mark.slow
def test_standard_errors_are_the_scatter_over_sheets():
    field = {"method": "patir", "lengths": (12, 12), "rms": 0.1, "correlation_length": 1.0, "shortest": 0.8}
    found = []
    for seed in range(16):
        heights, spacing = lattice_of(vg.make_shape("rough_sheet", **field, seed=seed))
        found.append(vg.surface_statistics(heights, spacing=spacing, shortest=0.0))
    for name in ("correlation_length", "hurst"):
        scatter = np.std([getattr(one, name) for one in found], ddof=1)
        stated = math.sqrt(np.mean([getattr(one, f"{name}_error") ** 2 for one in found]))
        assert stated == pytest.approx(scatter, rel=0.35)


def test_lengths_of_the_record_follow_the_size():
    one, two = (vg.make_shape("rough_sheet", diameter=size, seed=1) for size in (1.0, 2.0))
    for name in ("roughness_rms", "roughness_shortest", "roughness_correlation_length"):
        assert two.record[name] == pytest.approx(2 * one.record[name])
    assert one.record["roughness_rms"] == pytest.approx(np.std(one.vertices[:, 2]), rel=1e-9)
    assert vg.make_shape("rough_sheet", rms=0.0).record["roughness_rms"] == 0.0


def test_too_fine_a_sheet_is_refused():
    with pytest.raises(TooLargeError, match=r"give at least 0\.00"):
        vg.make_shape("rough_sheet", shortest=1e-4)


@pytest.mark.parametrize(
    ("given", "changed"), [slow({"correlation_length": 1e9}, "correlation_length"), ({"shortest": 2.5}, "shortest")]
)
def test_the_length_that_is_proposed_can_be_made(given, changed):
    with pytest.raises((InputError, TooLargeError), match=f"^{changed} is .*; give (at most|less than)") as caught:
        vg.make_shape("rough_sheet", **given)
    proposed = float(str(caught.value).rsplit(" ", 1)[1])
    assert vg.make_shape("rough_sheet", **{changed: 0.999 * proposed}).record["roughness_rms"] > 0


def sheet_of(x=1.0, y=1.0):
    flat = np.array([(0.0, 0.0), (x, 0.0), (0.0, y), (x, y)])
    return Folded(np.column_stack([flat, np.zeros(4)]), flat, lattice_faces(1, 1), np.zeros((0, 2), np.int64))


def test_one_fold_has_its_angle():
    half = np.deg2rad(35.0)
    direction = np.array([np.sin(half), 0.0, np.cos(half)])
    new = folded(sheet_of(), np.array([0.4, 0.3, 0.0]), direction)
    assert new.mean_length() == (pytest.approx(1.0), 1)
    moved = new.vertices[new.flat[:, 0] > 0.4 + 1e-9]
    # the far side of the sheet rises by twice half the angle
    assert np.arctan2(moved[:, 2], moved[:, 0] - 0.4) == pytest.approx(np.full(len(moved), -2 * half))
    kept = new.flat[:, 0] < 0.4 + 1e-9
    assert new.vertices[kept, :2] == pytest.approx(new.flat[kept])
    # a plane across both sides of the crease makes two creases of each, which cross
    again = folded(new, np.array([0.2, 0.5, 0.0]), np.array([0.0, np.sin(half), np.cos(half)]))
    assert again.mean_length()[1] == 4


def test_planes_near_a_vertex_are_left_out():
    assert folded(sheet_of(), np.zeros(3), np.array([0.6, 0.0, 0.8])) is None


@pytest.mark.parametrize("seed", range(8))
def test_crumpling_stretches_nothing(seed):
    shape = vg.make_shape("crumpled", seed=seed, aspect=(1.5, 1.0), fold_length=0.3)
    vertices, faces = shape.vertices, shape.faces
    assert count_crossings(vertices, faces) == 0
    assert shape.record["isometry_error"] < 1e-9
    assert shape.record["fold_length"] <= 0.3
    # intrinsically flat: the angles around each inner vertex are a full turn, without use of the flat sheet
    corners = vertices[faces]
    sides = [np.roll(corners, -k, axis=1) - corners for k in (1, 2)]
    cosine = (sides[0] * sides[1]).sum(axis=2) / np.prod([np.linalg.norm(side, axis=2) for side in sides], axis=0)
    total = np.bincount(faces.ravel(), np.arccos(np.clip(cosine, -1, 1)).ravel())
    ends, index = edges_of(faces)
    rim = np.unique(ends[np.bincount(index.ravel()) == 1])
    inner = np.setdiff1d(np.arange(len(vertices)), rim)
    assert total[inner] == pytest.approx(2 * np.pi, abs=1e-6)
    # the rim is a rectangle of these edges, whose four corners are right angles
    square = np.isclose(total[rim], np.pi / 2, atol=1e-6)
    assert square.sum() == 4
    assert total[rim][~square] == pytest.approx(np.pi, abs=1e-6)
    open_edges = ends[np.bincount(index.ravel()) == 1]
    around = np.linalg.norm(vertices[open_edges[:, 0]] - vertices[open_edges[:, 1]], axis=1).sum()
    assert around**2 / shape.surface_area == pytest.approx(4 * (1.5 + 1.0) ** 2 / 1.5, rel=1e-9)
    # and it is not flat
    assert (shape.bounds[1] - shape.bounds[0]).min() > 0.1


def test_shorter_folds_are_more():
    many, few = (
        np.mean([vg.make_shape("crumpled", seed=seed, fold_length=length).record["creases"] for seed in range(4)])
        for length in (0.2, 0.5)
    )
    assert many > 3 * few


def test_what_cannot_be_folded_is_told(monkeypatch):
    monkeypatch.setattr("voxgran.shapes.families.surfaces.crumpled.TRIES", 2)
    with pytest.raises(InputError, match=r"no other fold was found .*; give at least 0\.[1-9]"):
        vg.make_shape("crumpled", fold_length=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["rough_sheet", "crumpled"])
def test_a_thousand_sheets(family):
    for seed in range(1000):
        shape = vg.make_shape(family, seed=seed)
        assert np.isfinite(shape.vertices).all()
        assert count_crossings(shape.vertices, shape.faces) == 0
        if family == "crumpled":
            assert shape.record["isometry_error"] < 1e-9, seed


def test_a_sheet_too_coarse_for_a_correlation_length_is_told():
    sheet = vg.make_shape("rough_sheet", method="patir", lengths=(24, 24), correlation_length=16, rms=0.1, seed=1)
    with pytest.warns(PackingWarning, match="between neighbours; take a finer surface, or one several"):
        assert np.isnan(vg.surface_statistics(sheet).correlation_length)
