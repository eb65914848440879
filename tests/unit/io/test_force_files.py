"""Forces in files: packings keep them to the bit, scenes show them, statistics hold them, other formats drop them."""

from dataclasses import replace

import numpy as np
import pytest
from kit import column

import voxgran as vg
from voxgran._base.errors import FileFormatError
from voxgran._base.lazy import load as load_library
from voxgran.contacts.assembly import Lid
from voxgran.contacts.forces import ContactForces
from voxgran.io.record import from_record, to_record

NAMES = ("i", "j", "point", "normal", "force", "gap", "residual", "rattler")


def odd(packing, **changes):
    """Return the packing with forces that are no round numbers."""
    old = packing.forces
    new = {"force": old.force / 3, "gap": old.gap + 0.1, "residual": old.residual + 1e-3, **changes}
    return replace(packing, forces=replace(old, **new))


def assert_same(one, other):
    for name in NAMES:
        first, second = getattr(one, name), getattr(other, name)
        assert (first.dtype, first.shape) == (second.dtype, second.shape), name
        assert first.tobytes() == second.tobytes(), name
    assert one.friction == other.friction


@pytest.mark.parametrize("changes", [{}, {"friction": None}, {"rattler": [True, False, True]}])
def test_forces_reload_bit_for_bit(changes, tmp_path):
    packing = odd(column(3), **changes)
    vg.save(packing, tmp_path / "p.vtp")
    again = vg.load(tmp_path / "p.vtp")
    assert_same(again.forces, packing.forces)
    vg.save(again, tmp_path / "q.vtp")
    assert (tmp_path / "p.vtp").read_bytes() == (tmp_path / "q.vtp").read_bytes()


@pytest.mark.parametrize("count", [0, 2])
def test_no_contacts_are_known_forces_too(count, tmp_path):
    names = {name: [] for name in NAMES[:6]}
    forces = ContactForces(**names, residual=np.ones(count), rattler=np.ones(count, dtype=bool))
    packing = replace(column(2)[:count], forces=forces)
    vg.save(packing, tmp_path / "p.vtp")
    assert_same(vg.load(tmp_path / "p.vtp").forces, forces)


def test_files_without_forces_have_none(tmp_path):
    bare = replace(column(3), forces=None)
    vg.save(bare, tmp_path / "p.vtp")
    assert vg.load(tmp_path / "p.vtp").forces is None
    assert not any("forces" in name for name in {**to_record(bare).arrays, **to_record(bare).per_grain})
    for suffix in (".txt", ".csv"):
        vg.save(column(3), tmp_path / f"p{suffix}")
        assert vg.load(tmp_path / f"p{suffix}").forces is None


def test_other_programs_find_residuals_of_the_grains(tmp_path):
    vg.save(odd(column(3)), tmp_path / "p.vtp")
    data = load_library("pyvista").read(tmp_path / "p.vtp")
    assert data.point_data["forces_residual"].tolist() == [1e-3] * 3
    assert data.point_data["forces_rattler"].tolist() == [0, 0, 0]


def test_the_lid_reloads_bit_for_bit(tmp_path):
    """With it the same forces balance the grains as before."""
    lid = Lid(np.array([0.0, 0.0, 1.0]), 3.0 + 1e-15)
    packing = replace(column(3), lid=lid)
    vg.save(packing, tmp_path / "p.vtp")
    again = vg.load(tmp_path / "p.vtp")
    assert again == packing
    assert again.lid.normal.tobytes() == lid.normal.tobytes()
    assert again.lid.level == lid.level
    vg.save(replace(packing, lid=None), tmp_path / "q.vtp")
    assert vg.load(tmp_path / "q.vtp").lid is None
    record = to_record(packing)
    record.arrays["lid"] = np.array([0.0, 2.0, 0.0, 1.0])
    with pytest.raises(FileFormatError, match="normal of the lid"):
        from_record(record)


@pytest.mark.parametrize(
    ("name", "value"),
    [("forces_i", np.array([0, 1, 9])), ("forces_force", np.zeros((2, 3))), ("forces_friction", np.array([-1.0]))],
)
def test_damaged_forces_are_a_damaged_file(name, value):
    record = to_record(column(3))
    record.arrays[name] = value
    with pytest.raises(FileFormatError, match="holds no packing of voxgran"):
        from_record(record)
    del record.arrays["forces_gap"]
    with pytest.raises(FileFormatError, match="holds no packing of voxgran"):
        from_record(record)


def test_a_scene_shows_the_contacts_that_carry(tmp_path):
    packing = column(3)
    force = packing.forces.force.copy()
    force[0] = 0.0
    packing = replace(packing, forces=replace(packing.forces, force=force))
    vg.save_scene(packing, tmp_path / "s.vtm")
    blocks = load_library("pyvista").read(tmp_path / "s.vtm")
    assert blocks.keys() == ["grains", "container", "contacts", "forces"]
    lines = blocks["forces"]
    assert lines.cell_data["j"].tolist() == [1, -1]
    assert lines.points[:, 2].tolist() == [2.5, 1.5, 0.5, 0.0]
    assert lines.point_data["magnitude"].tolist() == [1.0, 1.0, 3.0, 3.0]
    assert lines.cell_data["normal_force"].tolist() == [1.0, 3.0]
    vg.save_scene(replace(packing, forces=None), tmp_path / "t.vtm")
    assert "forces" not in load_library("pyvista").read(tmp_path / "t.vtm").keys()  # noqa: SIM118  (no mapping)


def test_statistics_hold_the_forces(tmp_path):
    packing = odd(column(3))
    tree = vg.measure(packing, "forces")
    vg.save_statistics(tree, tmp_path / "s.nc")
    again = vg.load_statistics(tmp_path / "s.nc")
    for name in NAMES[:6]:
        assert again["forces"][name].values.tobytes() == getattr(packing.forces, name).tobytes()
    assert again["grains"].residual.values.tolist() == packing.forces.residual.tolist()
    assert again["grains"].rattler.dtype == bool
