"""Packing files reload bit for bit; scenes open with every part."""

import hashlib
import os

import numpy as np
import pytest

from voxgran._base.errors import FileFormatError, InputError, MissingFileError, OutputExistsError
from voxgran._base.lazy import load as load_library
from voxgran.containers.kinds.box import Box
from voxgran.io import vtk_files
from voxgran.io.vtk_files import load_packing, save_packing, save_scene
from voxgran.packing.model import Packing

ARRAYS = ("position", "scale", "shape_id", "orientation")
WORDS = ("density", "stop_reason", "unit", "provenance", "solid_fraction")


def assert_same(one, other):
    for name in ARRAYS:
        first, second = getattr(one, name), getattr(other, name)
        assert first.dtype == second.dtype
        assert first.shape == second.shape
        assert first.tobytes() == second.tobytes()
    assert [getattr(one, name) for name in WORDS] == [getattr(other, name) for name in WORDS]
    for first, second in zip(one.shapes, other.shapes, strict=True):
        assert first.key == second.key
        assert (first.name, first.unit, first.offset) == (second.name, second.unit, second.offset)
        assert first.vertices.tobytes() == second.vertices.tobytes()
    assert one.container.to_mapping() == other.container.to_mapping()
    assert one.container.mesh()[0].tobytes() == other.container.mesh()[0].tobytes()


@pytest.mark.parametrize("name", ["spheres", "mixed", "flat", "in_a_sphere"])
def test_a_packing_reloads_bit_for_bit(name, request, tmp_path):
    packing = request.getfixturevalue(name)
    save_packing(packing, tmp_path / "p.vtp")
    assert_same(packing, load_packing(tmp_path / "p.vtp"))


def test_orientations_are_not_normalized_again(mixed, tmp_path):
    crooked = mixed.orientation * (1 + 1e-12)
    packing = Packing(mixed.shapes, mixed.shape_id, mixed.scale, mixed.position, crooked, mixed.container)
    save_packing(packing, tmp_path / "p.vtp")
    assert load_packing(tmp_path / "p.vtp").orientation.tobytes() == crooked.tobytes()


@pytest.mark.parametrize("with_shapes", [True, False])
def test_an_empty_packing_reloads(mixed, with_shapes, tmp_path):
    empty = Packing.of(mixed.shapes if with_shapes else [], Box((1, 2, 3)), position=[])
    save_packing(empty, tmp_path / "p.vtp")
    assert_same(empty, load_packing(tmp_path / "p.vtp"))


def test_the_same_packing_gives_the_same_bytes(mixed, tmp_path):
    save_packing(mixed, tmp_path / "a.vtp")
    save_packing(load_packing(tmp_path / "a.vtp"), tmp_path / "b.vtp")
    assert (tmp_path / "a.vtp").read_bytes() == (tmp_path / "b.vtp").read_bytes()


def test_other_programs_find_the_values_of_the_grains(spheres, tmp_path):
    contacts = spheres.contacts(0.1)
    assert contacts.count == 1
    save_packing(spheres, tmp_path / "p.vtp")
    data = load_library("pyvista").read(tmp_path / "p.vtp")
    assert data.n_points == spheres.count
    assert data.n_cells == spheres.count
    np.testing.assert_array_equal(data["volume"], spheres.volumes)
    np.testing.assert_array_equal(data["radius"], spheres.diameters / 2)
    assert data["coordination_number"].sum() == 2 * contacts.count
    assert data.field_data["solid_fraction"][0] == spheres.solid_fraction
    assert data.field_data["unit"][0] == "mm"
    assert data.field_data["seed"][0] == "7"


def test_what_json_cannot_hold_is_refused_before_writing(spheres, tmp_path):
    packing = Packing.of(spheres.shapes, spheres.container, position=[], provenance={"x": object()})
    with pytest.raises(InputError, match=r"provenance cannot be written as JSON .*: keep to"):
        save_packing(packing, tmp_path / "p.vtp")
    assert list(tmp_path.iterdir()) == []


def test_numpy_numbers_in_the_provenance_become_plain(spheres, tmp_path):
    record = {"count": np.int64(3), "sizes": np.array([0.5, 1.5]), "flag": np.bool_(True)}
    save_packing(Packing.of(spheres.shapes, spheres.container, position=[], provenance=record), tmp_path / "p.vtp")
    assert load_packing(tmp_path / "p.vtp").provenance == {"count": 3, "sizes": [0.5, 1.5], "flag": True}


def test_an_existing_file_stays_unless_asked(spheres, mixed, tmp_path):
    save_packing(spheres, tmp_path / "p.vtp")
    with pytest.raises(OutputExistsError, match="not replaced unasked"):
        save_packing(mixed, tmp_path / "p.vtp")
    assert load_packing(tmp_path / "p.vtp").count == spheres.count


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match="is not there"):
        load_packing(tmp_path / "p.vtp")


def sealed(body):
    return body + vtk_files._SEAL % hashlib.sha256(body).hexdigest().encode()


@pytest.mark.parametrize(
    "body",
    [b"", b"<?xml version", b"<VTKFile type='ImageData'></VTKFile>", b"\x00\xff" * 50, b"<VTKFile type='PolyData'/>"],
)
def test_bad_xml_under_a_good_seal_is_one_sentence_and_prints_nothing(body, tmp_path, capfd):
    (tmp_path / "p.vtp").write_bytes(sealed(body))
    with pytest.raises(FileFormatError) as caught:
        load_packing(tmp_path / "p.vtp")
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "p.vtp") in str(caught.value)
    assert capfd.readouterr() == ("", "")


def rewrite(path, change):
    """Change the text of a packing file and seal it again."""
    body = path.read_bytes()[: -vtk_files._SEAL_LENGTH]
    path.write_bytes(sealed(change(body)))


def test_a_foreign_poly_data_is_no_packing(tmp_path):
    load_library("pyvista").Sphere().save(tmp_path / "p.vtp")
    with pytest.raises(FileFormatError, match="does not end with the seal"):
        load_packing(tmp_path / "p.vtp")
    (tmp_path / "p.vtp").write_bytes(sealed((tmp_path / "p.vtp").read_bytes()))
    with pytest.raises(FileFormatError, match=r"holds no packing .*format"):
        load_packing(tmp_path / "p.vtp")


def test_a_newer_layout_is_refused(spheres, tmp_path, monkeypatch):
    several = spheres + Packing.of(
        spheres.shapes, spheres.container, position=[spheres.container.bounds[1]], density=3.0, unit=spheres.unit
    )
    save_packing(several, tmp_path / "p.vtp")
    monkeypatch.setattr("voxgran.io.record.FORMAT", 1)
    with pytest.raises(FileFormatError, match="version 2: this voxgran reads up to 1; install a newer one"):
        load_packing(tmp_path / "p.vtp")


def test_a_renamed_array_is_missed(spheres, tmp_path):
    save_packing(spheres, tmp_path / "p.vtp")
    rewrite(tmp_path / "p.vtp", lambda body: body.replace(b'"orientation"', b'"ORIENTATION"'))
    with pytest.raises(FileFormatError, match="orientation"):
        load_packing(tmp_path / "p.vtp")


def test_a_scene_has_grains_container_and_contacts(mixed, tmp_path):
    save_scene(mixed, tmp_path / "out" / "scene & co.vtm", gap=0.2)
    blocks = load_library("pyvista").read(tmp_path / "out" / "scene & co.vtm")
    assert blocks.keys() == ["grains", "container", "contacts"]
    grains, contacts = blocks["grains"], blocks["contacts"]
    assert grains.n_cells == sum(len(mixed.shapes[s].faces) for s in mixed.shape_id)
    for grain in (0, 6, 16):
        cells = np.flatnonzero(grains.cell_data["grain"] == grain)
        corners = grains.extract_cells(cells).points
        expected = mixed.world_vertices(grain)
        assert len(corners) == len(expected)
        np.testing.assert_allclose(corners.min(axis=0), expected.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(blocks["container"].bounds, mixed.container.bounds.T.ravel())
    found = mixed.contacts(0.2)
    assert contacts.n_cells == found.count > 0
    np.testing.assert_array_equal(contacts.cell_data["gap"], found.gap)
    np.testing.assert_array_equal(contacts.cell_data["normal"], found.normal)


def test_many_spheres_are_points(spheres, tmp_path, monkeypatch):
    monkeypatch.setattr(vtk_files, "BALL_SURFACE_LIMIT", 2)
    save_scene(spheres, tmp_path / "s.vtm")
    blocks = load_library("pyvista").read(tmp_path / "s.vtm")
    assert "grains" not in blocks.keys()  # noqa: SIM118  (blocks are no mapping)
    np.testing.assert_allclose(blocks["spheres"]["radius"], [0.5, 0.7, 0.4])


def test_a_scene_of_nothing_is_its_container(spheres, tmp_path):
    save_scene(Packing.of([], spheres.container, position=[]), tmp_path / "s.vtm")
    assert load_library("pyvista").read(tmp_path / "s.vtm").keys() == ["container"]


def test_a_scene_stays_unless_asked(spheres, tmp_path):
    save_scene(spheres, tmp_path / "s.vtm")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    with pytest.raises(OutputExistsError):
        save_scene(spheres, tmp_path / "s.vtm")
    os.remove(tmp_path / "s.vtm")
    del before[tmp_path / "s.vtm"]
    with pytest.raises(OutputExistsError):
        save_scene(spheres, tmp_path / "s.vtm")
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
    with pytest.raises(FileFormatError, match=r"suffix '.vtp'"):
        save_scene(spheres, tmp_path / "s.vtp")
    with pytest.raises(InputError, match="gap"):
        save_scene(spheres, tmp_path / "t.vtm", gap=-1.0)


def test_a_folder_with_other_files_is_not_replaced_by_a_scene(spheres, tmp_path):
    target, folder = tmp_path / "results.vtm", tmp_path / "results"
    save_scene(spheres, target)
    save_scene(spheres, target, overwrite=True)
    for name, content in (("thesis.txt", "kept"), ("forces.vtp", "kept")):
        (folder / name).write_text(content)
        before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
        with pytest.raises(OutputExistsError, match=f"holds {name}, which voxgran did not write"):
            save_scene(spheres, target, overwrite=True)
        assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
        (folder / name).unlink()
