"""Files that are whole, with values that no program of good will writes: one error, or a result."""

import dataclasses
import sys

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, VoxgranError
from voxgran.cli import main

pytestmark = pytest.mark.usefixtures("forked_readers")

LABELS = np.zeros((16, 16, 16), dtype=np.uint8)
LABELS[2:8, 3:9, 4:10], LABELS[9:14, 9:15, 4:13] = 1, 2


def saved(change, path):
    """Save grains of a label image of which the surface of the first was changed, with its key and the seal."""
    grains = vg.packing_of_labels(LABELS, voxel_size=1.0)
    first, *rest = grains.shapes
    solid = first.geometry
    points, corners = change(solid.points, solid.corners)
    odd = dataclasses.replace(first, geometry=type(solid)(points, corners))
    object.__setattr__(grains, "shapes", (odd, *rest))
    vg.save(grains, path)


def used(path):
    """Load a packing and compute what depends on its shapes."""
    grains = vg.load(path)
    vg.describe(list(grains.shapes))
    grains.verify()


STEPS = {
    **{f"step {one:g}": {"step": np.full(3, one)} for one in (0.0, -1.0, 1e300, 1e-300, np.nan, np.inf)},
    "one step of 0": {"step": np.array([1.0, 0.0, 1.0])},
    **{f"first {one:g}": {"first": np.full(3, one)} for one in (1e300, np.nan, -np.inf)},
}


@pytest.mark.parametrize("name", STEPS)
def test_lattices_of_shapes_are_lattices(name, tmp_path):
    """They ended in errors of Qhull, in divisions by 0, or in arrays of no numbers."""
    try:
        with np.errstate(all="ignore"):
            saved(lambda points, corners: (points._replace(**STEPS[name]), corners), tmp_path / "a.vtp")
    except Exception as error:  # noqa: BLE001
        pytest.skip(f"not written ({error})")
    with pytest.raises(FileFormatError, match="holds no packing of voxgran"):
        used(tmp_path / "a.vtp")


@pytest.mark.parametrize("flat", [[0, 0, 0], [1, 1, 0], [1, 0, 1]])
def test_solids_of_shapes_have_a_volume(flat, tmp_path):
    def change(points, corners):
        return points._replace(steps=(points.steps * flat).astype(np.int32)), corners

    try:
        saved(change, tmp_path / "a.vtp")
    except Exception as error:  # noqa: BLE001
        pytest.skip(f"not written ({error})")
    with pytest.raises(FileFormatError, match="faces without volume"):
        used(tmp_path / "a.vtp")


def test_learned_grains_have_a_volume(tmp_path):
    netcdf = pytest.importorskip("netCDF4")
    path = tmp_path / "m.nc"
    vg.learn_shapes([vg.make_shape("voronoi_fragment", seed=k) for k in range(10)]).save(path)
    with netcdf.Dataset(path, "a") as file:
        kept = file["vertices"][...]
    for change in (0.0 * kept, kept * [1, 1, 0], kept * 1e300, kept * 1e-300, kept * np.nan):
        with netcdf.Dataset(path, "a") as file:
            file["vertices"][...] = change
        with pytest.raises(VoxgranError, match=r"without volume|do not fit"):
            vg.ShapeModel.load(path)


NAMES = {
    "name": ".".join(["a"] * 20_000) + " = 1",
    "blanks": " . ".join(["1"] * 20_000) + " = 1",
    "quotes": '."a, ]".'.join(["a"] * 10_000) + " = 1",
    "table": "[" + ".".join(["a"] * 20_000) + "]",
    "rows": "[[" + ".".join(["a"] * 20_000) + "]]",
    "within": "a = [1.5, {b = 1, " + ".".join(["a"] * 20_000) + " = 1}]",
}


@pytest.mark.parametrize("name", NAMES)
def test_names_in_scenes_have_few_parts(name, tmp_path):
    """The time to read one of many parts grew with their square: 20,000 take minutes."""
    (tmp_path / "a.toml").write_text(NAMES[name])
    with pytest.raises(FileFormatError, match="more than 32 parts"):
        vg.Scene.from_toml(tmp_path / "a.toml")


def test_scenes_may_have_long_lists_and_rows_of_points(tmp_path):
    numbers = ", ".join(["1.25e-3"] * 1000)
    comment = "# " + "." * 100
    text = f"{comment}\n[[shape]]\nfamily = 'sphere'\n[packing]\nx = {{a = [{numbers}], b = [[{numbers} ] , 2.5]}}\n"
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(VoxgranError) as told:
        vg.Scene.from_toml(tmp_path / "a.toml")
    assert "TOML" not in str(told.value)


def test_scenes_have_a_size(tmp_path):
    (tmp_path / "a.toml").write_text("# " + "a" * 2**22)
    with pytest.raises(FileFormatError, match="scenes have at most 4194304"):
        vg.Scene.from_toml(tmp_path / "a.toml")


SCENE = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 2},
}
#: numbers that are none, or too large for anything
ODD = ("0", "-1", "1e300", "-1e300", "1e-300", "nan", "inf", "9223372036854775807", "true", "'x'", "[]", "{}", "[[]]")


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize(
    "place",
    ["container.lengths = [%s, 4, 4]", "container.lengths = %s", "packing.count = %s", "packing.tries = %s",
     "packing.solid_fraction = %s", "shape.diameter = %s", "shape = %s", "sizes = {kind = 'uniform', low = %s}",
     "scene.seed = %s", "output.snapshots = %s", "settle.friction = %s", "measure.which = %s", "container = %s"],
)  # fmt: skip
def test_absurd_numbers_of_scenes_are_one_sentence(place, odd, tmp_path, capsys):
    key, _, value = place.partition(" = ")
    value = value % odd
    given = {
        "container.lengths": "[4, 4, 4]", "packing.count": "2", "shape.family": "'sphere'", "container.kind": "'box'",
        "packing.method": "'rsa'", key: value,
    }  # fmt: skip
    if key in ("container", "shape"):
        given = {name: one for name, one in given.items() if not name.startswith(f"{key}.")}
    own = {name.partition(".")[2]: one for name, one in given.items() if name.startswith("shape.")}
    lines = [f"{name} = {one}" for name, one in given.items() if not name.startswith("shape.")]
    if own:
        lines += ["[[shape]]", *(f"{name} = {one}" for name, one in own.items())]
    (tmp_path / "a.toml").write_text("\n".join(lines))
    assert main(["plan", str(tmp_path / "a.toml")]) in (0, 2)
    assert "Traceback" not in capsys.readouterr().err
    assert sys.exc_info() == (None, None, None)


@pytest.mark.parametrize("corner", [0.0, np.nan, np.inf, 3e38, 1e-44])
def test_vessels_of_no_triangles_are_refused(corner, tmp_path):
    """Where all triangles fall together there was nothing to take the largest of."""
    facet = np.full(9, corner, dtype="<f4").tobytes()
    (tmp_path / "a.stl").write_bytes(bytes(80) + (4).to_bytes(4, "little") + (bytes(12) + facet + bytes(2)) * 4)
    for read in (vg.Vessel, vg.load_shape):
        with np.errstate(all="ignore"), pytest.raises(VoxgranError):
            read(tmp_path / "a.stl")


@pytest.mark.parametrize("name", ["vertices", "faces", "vertex_count", "face_count", "weights", "donors"])
def test_learned_shapes_have_arrays_of_one_form(name, tmp_path):
    """Any of them of another type, with another number of columns, or another dimension."""
    netcdf, path = pytest.importorskip("netCDF4"), tmp_path / "m.nc"
    vg.learn_shapes([vg.make_shape("voronoi_fragment", seed=k) for k in range(10)]).save(path)
    with netcdf.Dataset(path) as file:
        kept = {key: np.ma.getdata(values[...]) for key, values in file.variables.items()}
        facts = {key: file.getncattr(key) for key in file.ncattrs()}
    own = kept[name]
    others = [
        own[..., None],
        own[:1],
        own.astype(np.float32) + 0.5,
        own * 0 - 1,
        own[:, :2] if own.ndim > 1 else own[:0],
    ]
    for array in others:
        with netcdf.Dataset(path, "w") as file:
            file.setncatts(facts)
            for key, values in {**kept, name: array}.items():
                sizes = [f"{key}_{k}" for k in range(values.ndim)]
                for size, length in zip(sizes, values.shape, strict=True):
                    file.createDimension(size, length)
                file.createVariable(key, values.dtype, sizes)[...] = values
        if name in ("vertices", "weights", "donors") and array is others[2]:
            continue
        with pytest.raises(VoxgranError):
            vg.ShapeModel.load(path)
