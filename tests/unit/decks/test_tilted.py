"""Tilted periodic cells in files of engines, and in LAMMPS and YADE where they are installed."""

import dataclasses
import os
import re
import subprocess

import engine_cases as cases
import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError

TILT = (2.5, -1.7, 2.1)


def overlapping():
    """Return jammed spheres that overlap by 2e-4 of their sizes."""
    box = vg.Box((6, 5, 7), "xyz", tilt=TILT, origin=(1, -2, 0.5))
    jammed = vg.pack(vg.make_shape("sphere"), box, "jam", seed=3, count=150, unit="mm", density=2000)
    return dataclasses.replace(jammed, scale=jammed.scale * 1.0002)


def test_engines_have_tilted_cells_or_refuse_them(tmp_path):
    box = vg.Box((6, 5, 7), "xyz", tilt=TILT)
    packing = vg.Packing.of(vg.make_shape("sphere"), box, position=[(1, 1, 1)], unit="mm")
    for name in ("lammps", "mercury", "yade"):
        vg.write_deck(packing, tmp_path / name, name)
    for name in set(vg.engines()) - {"lammps", "mercury", "yade"}:
        with pytest.raises(
            InputError, match=r"tilt .*, wh.*, takes upright .* 'lammps' or 'mercury' or 'yade'|is periodic: "
        ):
            vg.write_deck(packing, tmp_path / name, name)
    with pytest.raises(InputError, match="a cell of LAMMPS that keeps a stress takes upright containers only"):
        vg.write_deck(packing, tmp_path / "servo", "lammps", stress=1e3)


def ghosts_of_mercury(position, boundaries, reach):
    """Return positions and grains with copies as MercuryDPM makes them, one across the nearer side of a boundary."""
    grain = np.arange(len(position))
    for normal, low, high, side in boundaries:
        level, shift = position @ normal, normal * (high - low) + side
        near = np.minimum(level - low, high - level) < reach
        sign = np.where(high - level > level - low, 1.0, -1.0)
        position = np.concatenate([position, (position + sign[:, None] * shift)[near]])
        grain = np.concatenate([grain, grain[near]])
    return position, grain


@pytest.mark.parametrize("tilt", [TILT, (-2.9, 1.9, -2.4), (0, 0, 0)])
def test_mercury_finds_the_contacts_of_tilted_cells(tmp_path, tilt):
    box = vg.Box((6, 5, 7), "xyz", tilt=tilt, origin=(1, -2, 0.5))
    packing = vg.pack(vg.make_shape("sphere"), box, "jam", seed=3, count=150, unit="m", density=2000)
    packing = dataclasses.replace(packing, scale=packing.scale * 1.0002)
    vg.write_deck(packing, tmp_path, "mercury")
    calls = re.findall(r" addPeriodic\((.*)\);", (tmp_path / "mercury_run.cpp").read_text())
    numbers = np.array([re.findall(r"-?\d[\d.e+-]*", call.replace("Vec3D", "")) for call in calls], dtype=float)
    # grains that a boundary moves out of the box are brought back by those that follow
    assert np.flatnonzero(numbers[:, :3])[::-1].tolist() == [6, 4, 2]
    lengths = numbers[:, 4] - numbers[:, 3]
    assert (np.abs(numbers[:, 5:]) <= lengths[::-1] / 2 + 1e-12).all()
    boundaries = [(row[:3], row[3], row[4], row[5:]) for row in numbers]
    radii = 0.5 * packing.diameters
    rows = (tmp_path / "mercury_grains.csv").read_text().splitlines()
    inside = np.array([row.split(",")[3:6] for row in rows if row.startswith("sphere")], dtype=float)
    position, grain = ghosts_of_mercury(inside, boundaries, 2 * radii.max())
    pairs = cKDTree(inside).sparse_distance_matrix(cKDTree(position), 2 * radii.max(), output_type="ndarray")
    i, j = pairs["i"], grain[pairs["j"]]
    touch = (pairs["v"] < radii[i] + radii[j]) & (pairs["j"] != i)
    found = sorted(zip(i[touch].tolist(), j[touch].tolist(), strict=True))
    known = packing.contacts(0.0)
    both = [(a, b) for a, b in zip(known.i.tolist(), known.j.tolist(), strict=True) if b >= 0]
    assert found == sorted(both + [(b, a) for a, b in both])


def test_mercury_refuses_cells_whose_copies_it_does_not_make(tmp_path):
    packing = vg.Packing.of(vg.make_shape("sphere"), vg.Box((6, 5, 7), "xyz", tilt=(2.6, 2.6, 0)), position=[(1, 1, 1)])
    with pytest.raises(InputError, match="more together than the length along x of 6 m less a grain of 1 m"):
        vg.write_deck(packing, tmp_path, "mercury")


def test_the_data_file_of_lammps_is_read_back(tmp_path):
    packing = overlapping()
    vg.write_deck(packing, tmp_path, "lammps")
    read = vg.load(tmp_path / "lammps_grains.data", unit="m").to_unit("mm")
    assert read.container.periodic == (True, True, True)
    assert read.container.tilt == pytest.approx(TILT, rel=1e-12)
    assert read.container.origin == pytest.approx((1, -2, 0.5))
    assert read.contacts(0.0).count == packing.contacts(0.0).count > 400


@pytest.mark.parametrize("kind", ["xy xz yz", "abc origin"])
@pytest.mark.parametrize("scaled", [False, True])
def test_dumps_of_tilted_cells_are_read(tmp_path, kind, scaled):
    packing = overlapping()
    (xy, xz, yz), low, lengths = packing.container.tilt, packing.container.bounds[0], packing.container.lengths
    ends = np.array([[min(0, xy, xz, xy + xz), max(0, xy, xz, xy + xz)], [min(0, yz), max(0, yz)], [0, 0]])
    rows = np.column_stack([low, low + lengths]) + ends
    rows = np.column_stack([rows, packing.container.tilt])
    if kind == "abc origin":
        rows = np.column_stack([packing.container.vectors, low])
    places = (packing.position - low) @ np.linalg.inv(packing.container.vectors) if scaled else packing.position
    names = "xs ys zs" if scaled else "x y z"
    text = ["ITEM: TIMESTEP", "0", "ITEM: NUMBER OF ATOMS", str(packing.count), f"ITEM: BOX BOUNDS {kind} pp pp pp"]
    text += [" ".join(map(repr, row)) for row in rows.tolist()] + [f"ITEM: ATOMS id {names} radius"]
    radii = packing.bounding_radii.tolist()
    text += [
        f"{k} {x!r} {y!r} {z!r} {r!r}" for k, ((x, y, z), r) in enumerate(zip(places.tolist(), radii, strict=True))
    ]
    (tmp_path / "a.dump").write_text("\n".join(text) + "\n")
    read = vg.load(tmp_path / "a.dump")
    assert read.container.tilt == pytest.approx(TILT, rel=1e-12)
    assert read.container.bounds == pytest.approx(packing.container.bounds)
    assert read.position == pytest.approx(packing.position, abs=1e-12)


def test_files_keep_the_tilt(tmp_path):
    packing = vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 5), "xyz", tilt=TILT), "rsa", count=5)
    for name in ("a.vtp", "a.xyzr"):
        vg.save(packing, tmp_path / name)
        assert vg.load(tmp_path / name).container == packing.container
    edges = " ".join(map(repr, packing.container.vectors.ravel().tolist()))
    lines = [f"S {x!r} {y!r} {z!r} 0.5" for x, y, z in packing.position.tolist()]
    head = f'Lattice="{edges}" Properties=species:S:1:pos:R:3:radius:R:1'
    (tmp_path / "a.xyz").write_text("\n".join(["5", head, *lines]) + "\n")
    assert vg.load(tmp_path / "a.xyz").container == packing.container


def output_of(folder, *command):
    """Return what a program prints, which does not get the modules of this one."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=clean, check=False, timeout=280)
    return done.stdout + done.stderr


@pytest.mark.engine
def test_lammps_finds_the_same_contacts(tmp_path):
    program, packing = cases.program("lmp", "make test-engines"), overlapping()
    vg.write_deck(packing, tmp_path, "lammps")
    file = tmp_path / "lammps_run.in"
    head = file.read_text().partition("\ntimestep")[0]
    sums = "compute touch all contact/atom\ncompute sum all reduce sum c_touch\nthermo_style custom step c_sum\nrun 0\n"
    file.write_text(f"{head}\n{sums}")
    found = re.search(
        r"^\s+0\s+(\d+)\s*$", output_of(tmp_path, program, "-in", file.name, "-log", "none"), re.MULTILINE
    )
    # each contact counts for both spheres
    assert int(found[1]) == 2 * packing.contacts(0.0).count


@pytest.mark.engine
def test_yade_finds_the_same_contacts(tmp_path):
    program, packing = cases.program("yade", "apt-get install yade"), overlapping()
    vg.write_deck(packing, tmp_path, "yade")
    file = tmp_path / "yade_run.py"
    count = 'O.run(1, True)\nprint("REAL", sum(1 for one in O.interactions if one.isReal))\n'
    file.write_text(re.sub(r"^run\(\)\n", count, file.read_text(), flags=re.MULTILINE))
    output = output_of(tmp_path, program, "-n", "-x", file.name)
    assert int(re.search(r"REAL (\d+)", output)[1]) == packing.contacts(0.0).count


@pytest.mark.engine
def test_a_bed_in_a_tilted_cell_rests_in_lammps(monkeypatch):
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", "make test-engines"))
    box = vg.Box((6, 5, 9), "xy", tilt=(2.5, 0, 0))
    bed = vg.pack(vg.make_shape("sphere"), box, "gravity", seed=3, count=100, unit="mm", density=2000)
    rested, history = vg.relax(bed)
    assert rested.container == bed.container
    assert history.attrs["rests"] == 1
    assert history.attrs["sinking"] < 0.05
