"""The benchmark of surfaces of labels: bodies in closed form, peers in the same place, manifolds and crossings told."""

import csv

import numpy as np
import pytest

from benchmarks.images import labels
from benchmarks.images.labels import bodies, crossings, crowded, is_manifold, programs
from voxgran.geometry.triangles import enclosed_volume
from voxgran.shapes.tessellate import unit_box

CORNERS, FACES = unit_box()[:2]


@pytest.mark.parametrize("kind", ["sphere", "ellipsoid", "cube", "voronoi"])
def test_bodies_have_the_volumes_and_areas_that_are_stated(kind):
    image, volumes, areas, compared = bodies(kind, 12)
    assert len(volumes) == len(areas) == len(compared) == (27 if kind == "voronoi" else 8)
    assert np.bincount(image.ravel())[compared].sum() == pytest.approx(volumes.sum(), rel=0.01)
    # no body has less surface than the sphere of its volume
    least = (36 * np.pi * volumes**2) ** (1 / 3)
    assert (areas / least == pytest.approx(1.0)) if kind == "sphere" else (areas > 1.05 * least).all()


@pytest.mark.parametrize("make", [lambda: bodies("cube", 10)[0], lambda: crowded(24, 4)])
def test_every_program_gives_closed_surfaces_where_the_labels_are(make):
    image = make()
    made = {name: surfaces_of(work()) for name, (work, surfaces_of) in programs(image).items()}
    assert len(made) == 4
    for name, surfaces in made.items():
        assert len(surfaces) == image.max()
        for label, (points, faces) in enumerate(surfaces, 1):
            # a label that touches itself in an edge of voxels is not parted there by VTK
            assert is_manifold(points, faces) or name.startswith("VTK")
            voxels = np.argwhere(image == label)
            assert 0.7 * len(voxels) < enclosed_volume(points, faces) < 1.1 * len(voxels)
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            assert middle == pytest.approx((voxels.min(axis=0) + voxels.max(axis=0) + 1) / 2, abs=1.0)


def test_manifolds_are_told_from_open_pinched_and_turned_surfaces():
    assert is_manifold(CORNERS, FACES)
    assert not is_manifold(CORNERS, FACES[1:])
    assert not is_manifold(CORNERS, np.concatenate([FACES[:1, ::-1], FACES[1:]]))
    # two cubes with a common corner
    far = FACES + 8
    far[far == 8] = 7
    assert not is_manifold(np.concatenate([CORNERS, CORNERS + 1.0]), np.concatenate([FACES, far]))


def test_crossings_are_those_of_different_grains_and_not_of_shared_triangles():
    cube = CORNERS.astype(float), FACES
    assert crossings([cube, (CORNERS + np.array([1.0, 0, 0]), FACES)]) == 0
    assert crossings([cube, cube]) == 0
    moved = CORNERS + np.array([0.3, 0.4, 0.6]), FACES
    assert crossings([cube, cube, moved]) == crossings([cube, moved]) > 5


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(labels, "REPEATS", 1)
    monkeypatch.setattr(labels, "POINTS", 4)
    monkeypatch.setattr(labels, "measured", lambda measured=labels.measured: measured((8,)))
    monkeypatch.setattr(labels, "measured_crowd", lambda measured=labels.measured_crowd: measured(20, 4))
    monkeypatch.setattr(labels, "measured_large", lambda measured=labels.measured_large: measured((20, 4), (1, 2)))
    table, crowd, large, figure = labels.run(tmp_path)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert len(rows) == 16
    assert all(float(row["cpu_seconds"]) > 0 for row in rows)
    own = {row["body"]: row for row in rows if row["program"] == "voxgran"}
    assert all(float(row["volume_error"]) < 0.02 for row in own.values())
    assert all(abs(float(own[name]["area_error"])) < 0.04 for name in ("sphere", "ellipsoid", "voronoi"))
    rows = list(csv.DictReader(crowd.read_text().splitlines()))
    names = ["voxgran, as a packing", "voxgran, verify of the packing", "voxgran"]
    assert [row["program"] for row in rows][:3] == names
    assert all(float(row["cpu_seconds_over_calibration"]) > 0 for row in rows)
    assert {(row["closed_manifolds"], row["crossing_pairs"]) for row in rows[:4]} == {(rows[0]["labels"], "0")}
    rows = list(csv.DictReader(large.read_text().splitlines()))
    assert [row["voxels_along_an_edge"] for row in rows] == ["20", "40"]
    assert [int(row["labels"]) for row in rows] == [4, 32]
    # corners of triangles in two bytes each or less, and 12 for each of half as many vertices
    assert all(9 < float(row["bytes_of_a_triangle"]) < 14 for row in rows)
    assert all(float(row["file_over_image"]) > 0 and float(row["largest_memory_mib"]) > 0 for row in rows)
    assert "<svg" in figure.read_text()
