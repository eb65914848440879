"""Statistics go through netCDF4 unchanged."""

import numpy as np
import pytest
import xarray as xr

from voxgran._base.errors import FileFormatError, OutputExistsError
from voxgran.io.netcdf import load_statistics, save_statistics

pytestmark = pytest.mark.usefixtures("forked_readers")


@pytest.fixture
def tree():
    sizes = xr.DataArray(np.linspace(0, 1, 5000), dims="grain", attrs={"units": "mm", "long_name": "diameter"})
    root = xr.Dataset({"solid_fraction": 0.61, "count": 7}, attrs={"unit": "mm", "seed": 3})
    grains = xr.Dataset({"diameter": sizes, "big": sizes > 0.5, "id": ("grain", np.arange(5000, dtype=np.uint64))})
    profile = xr.Dataset({"phi": ("z", [0.1, np.nan])}, coords={"z": [0.5, 1.5], "name": ("z", ["floor", "sød"])})
    empty = xr.Dataset({"gap": ("contact", np.zeros(0))})
    parts = {"/": root, "/grains": grains, "/profiles/axis": profile, "/contacts": empty}
    return xr.DataTree.from_dict(parts, name="measures")


def test_a_tree_makes_an_identical_round_trip(tree, tmp_path):
    save_statistics(tree, tmp_path / "s.nc")
    again = load_statistics(tmp_path / "s.nc")
    xr.testing.assert_identical(again, tree)
    assert again["/grains"]["id"].dtype == np.uint64
    assert again["/grains"]["big"].dtype == bool
    assert (tmp_path / "s.nc").stat().st_size < 60_000


def test_attributes_become_what_netcdf_can_hold(tmp_path):
    given = {
        "flag": True,
        "nothing": None,
        "mapping": {"a": [1, None]},
        "list": [1.5, 2.5],
        "large": 2**70,
        "number": np.float64(0.25),
        "empty": [],
    }
    tree = xr.DataTree(xr.Dataset({"x": ("n", [1.0], {"flag": np.bool_(False), "where": (1, 2)})}, attrs=given))
    save_statistics(tree, tmp_path / "s.nc")
    again = load_statistics(tmp_path / "s.nc")
    kept = {name: value for name, value in again.attrs.items() if name not in ("list", "empty")}
    expected = {"flag": 1, "mapping": '{"a": [1, null]}', "large": str(2**70), "number": 0.25}
    assert kept == expected
    assert list(again.attrs["list"]) == [1.5, 2.5]
    assert again["x"].attrs["flag"] == 0
    assert tree.attrs == given
    assert tree["x"].attrs["where"] == (1, 2)


def test_the_file_is_closed_and_can_be_replaced(tree, tmp_path):
    save_statistics(tree, tmp_path / "s.nc")
    again = load_statistics(tmp_path / "s.nc")
    save_statistics(again, tmp_path / "s.nc", overwrite=True)
    xr.testing.assert_identical(load_statistics(tmp_path / "s.nc"), again)
    with pytest.raises(OutputExistsError):
        save_statistics(tree, tmp_path / "s.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["s.nc"]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.95])
def test_a_damaged_file_is_one_sentence(tree, share, tmp_path, capfd):
    save_statistics(tree, tmp_path / "s.nc")
    whole = (tmp_path / "s.nc").read_bytes()
    (tmp_path / "s.nc").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(FileFormatError, match=r"cannot be read as a \.nc file") as caught:
        load_statistics(tmp_path / "s.nc")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""
