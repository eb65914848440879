"""`.voxgran` on surfaces of PyVista and on statistics of xarray."""

import json
import subprocess
import sys
from importlib.metadata import entry_points

import numpy as np
import pytest
import pyvista
import xarray

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, UnknownNameError
from voxgran.measures.accessor import register_accessor

pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds")
old_pyvista = not hasattr(pyvista, "register_dataset_accessor")


@pytest.mark.skipif(old_pyvista, reason="PyVista has accessors from 0.48 on")
def test_a_surface_of_pyvista_is_a_grain():
    cube = pyvista.Cube(x_length=2.0)
    assert cube.voxgran.diagnose().ok
    assert cube.voxgran.to_shape("cube").volume == pytest.approx(2.0)
    assert cube.voxgran.voxelize(0.25).mask.sum() == 8 * 4 * 4
    open_cube = cube.triangulate().extract_cells(np.arange(11)).extract_surface(algorithm="dataset_surface")
    with pytest.raises(DirtyMeshError):
        open_cube.voxgran.to_shape()
    mended = open_cube.voxgran.repair(max_hole=1.0)
    assert mended.shape.volume == pytest.approx(2.0)


@pytest.mark.skipif(old_pyvista, reason="PyVista has accessors from 0.48 on")
def test_pyvista_finds_it_by_its_entry_point_alone():
    assert [entry.value for entry in entry_points(group="pyvista.accessors", name="voxgran")] == [
        "voxgran.io.pyvista_accessor"
    ]
    code = (
        "import sys, pyvista; before = 'voxgran' in sys.modules; print(before, pyvista.Sphere().voxgran.diagnose().ok)"
    )
    out = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["False", "True"]


@pytest.fixture(scope="module")
def packing():
    return vg.Packing.of(
        [vg.make_shape("sphere")],
        vg.Box((2, 2, 2), periodic="xyz"),
        position=[(0.5, 0.5, 0.5), (1.5, 1.5, 1.5)],
        provenance={"method": "by hand", "parameters": {"patience": 3}},
        unit="mm",
    )


def test_statistics_tell_numbers_units_and_provenance(packing, tmp_path):
    tree = vg.measure(packing, which=["density"])
    assert tree.voxgran.numbers["solid_fraction"] == packing.solid_fraction
    assert tree.voxgran.numbers["count"] == 2
    assert tree.voxgran.text("count") == "number of grains: 2"
    assert "by hand" in json.dumps(tree.voxgran.provenance)
    vg.save_statistics(tree, tmp_path / "statistics.nc")
    again = vg.load_statistics(tmp_path / "statistics.nc")
    assert again.voxgran.numbers == pytest.approx(tree.voxgran.numbers, rel=1e-15, nan_ok=True)
    assert again["/provenance"].to_dataset().voxgran.provenance == tree.voxgran.provenance
    with pytest.raises(UnknownNameError, match="did you mean 'solid_fraction'"):
        tree.voxgran.text("solid_fractoin")


def test_it_says_not_known_for_what_is_not_known():
    register_accessor()
    register_accessor()
    dataset = xarray.Dataset({"gap": ((), np.nan, {"units": "mm", "long_name": "mean gap"}), "row": ("x", [1.0])})
    assert dataset.voxgran.text("gap") == "mean gap: not known mm"
    assert list(dataset.voxgran.numbers) == ["gap"]
    assert dataset.voxgran.provenance == {}


def test_notebooks_show_a_picture_and_numbers(packing):
    card = packing._repr_html_()
    for word in ("data:image/png;base64,", "2 grains of 1 shapes", "by hand", "box, periodic in x, y, z", "1 to 1 mm"):
        assert word in card
    assert "<script" not in card.split("<iframe")[0]
    shape = vg.make_shape("cone")
    assert "<img" in shape._repr_html_()
    assert "cone (cone)" in shape._repr_html_()
    named = vg.Shape.from_mesh(shape.vertices, shape.faces, name="<b>bold</b>")
    assert "<b>" not in named._repr_html_()
    flat = vg.Packing.of([vg.make_shape("disk")], vg.Rectangle((3, 3)), position=np.zeros((0, 3)))
    assert "<img" not in flat._repr_html_()
    json.dumps(flat._repr_html_())
