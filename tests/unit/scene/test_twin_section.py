"""The section [twin] of a scene: what it packs, with several seeds, as an axis of a study, and what is refused."""

import json

import numpy as np
import pytest
import xarray

import voxgran as vg
from voxgran._base.errors import VoxgranError
from voxgran.cli import main

ASKED = {"sample": "scan.vtp", "count": 20, "protocol": "expand", "voxel_size": 0.25}
QUICK = {"output": {"vtk": False, "report": False}, "measure": {"which": ["coordination"]}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a sample of spheres, which stands for a scan."""
    place = tmp_path_factory.mktemp("twin")
    box, sizes = vg.Box((4, 4, 4), periodic="xyz"), vg.sizes.lognormal(median=1.0, sigma=0.2)
    spheres = vg.pack(vg.shapes.sphere(), box, "expand", count=60, solid_fraction=0.5, sizes=sizes, unit="mm")
    vg.save(spheres, place / "scan.vtp")
    return place


def scene_of(folder, **more):
    """Return a scene with a twin of the sample."""
    return vg.Scene.from_mapping({"twin": ASKED | more, **QUICK}, folder=folder)


def test_a_scene_packs_what_twin_packs_with_bands_over_its_seeds(folder, tmp_path):
    scene = vg.Scene.from_mapping({"scene": {"seed": 2, "seeds": 2}, "twin": ASKED, **QUICK}, folder=folder)
    plan = scene.plan()
    assert plan.grains == 20
    assert "learn the shapes of 60 grains of the sample" in plan.computed
    assert vg.Scene.from_mapping(json.loads(json.dumps(scene.to_mapping()))) == scene
    result = scene.run(tmp_path / "out")
    twin = vg.twin(vg.load(folder / "scan.vtp"), count=20, protocol="expand", voxel_size=0.25, seed=2, seeds=2)
    other = vg.load(tmp_path / "out/seed_3/packing.vtp")
    for mine, packing in zip((result.packing, other), twin.packings, strict=True):
        assert (mine.position == packing.position).all()
        assert mine.unit == "mm"
    assert result.summary["twin"]["sample_solid_fraction"] == pytest.approx(0.5)
    with xarray.open_dataset(tmp_path / "out/comparison.nc") as kept:
        for name in ("tortuosity", "coordination_number"):
            mine, found = (data.sel(measure=name) for data in (kept, twin.comparison))
            assert float(mine["twin_scatter"]) == pytest.approx(float(found["twin_scatter"]))


def test_a_twin_fills_the_container_of_the_scene(folder):
    box = {"kind": "box", "lengths": [5, 5, 5], "periodic": [True] * 3}
    asked = {key: value for key, value in ASKED.items() if key != "count"}
    scene = vg.Scene.from_mapping({"twin": asked, "container": box, **QUICK}, folder=folder)
    assert scene.count == pytest.approx(60 * 125 / 64, rel=0.05)
    assert vg.Scene.from_mapping(scene.to_mapping()) == scene
    assert scene.to_mapping()["container"]["lengths"] == [5, 5, 5]


@pytest.mark.usefixtures("forked_workers")
def test_twins_and_models_are_axes_of_studies(folder, tmp_path):
    axes = {"twin.protocol": ["expand", "compress"], "twin.count": [15, 20]}
    study = vg.Study(base=scene_of(folder), axes=axes, seeds=2)
    assert [cell.scene.method for cell in study.cells()] == ["expand", "expand", "compress", "compress"]
    only = vg.Study(base=scene_of(folder), axes={"twin.count": [15, 25]}, seeds=2)
    data = only.run(tmp_path / "out", workers=1).dataset
    numbers = data["mean_coordination_number"].values
    assert np.isfinite(numbers).all()
    assert np.ptp(numbers, axis=-1).max() > 0  # each seed has its twin
    with pytest.raises(VoxgranError, match="same numbers"):
        vg.Study(base=scene_of(folder), axes={"twin.voxel_size": [0.2, 0.3]}).cells()


@pytest.mark.usefixtures("forked_workers")
def test_learned_shapes_are_an_axis_of_a_study(tmp_path):
    for name, aspect in (("long", (2.0, 1.0, 0.8)), ("round", (1.0, 1.0, 0.9))):
        vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12, aspect=aspect)).save(tmp_path / f"{name}.nc")
    base = {
        "shape": [{"model": "long.nc", "count": 4}],
        "container": {"kind": "box", "lengths": [12, 12, 12]},
        "packing": {"method": "rsa", "count": 6},
        "measure": {"which": ["density"]},
    }
    given = base | {"shape": [{"model": str(tmp_path / "long.nc"), "count": 4}]}
    names = [str(tmp_path / f"{name}.nc") for name in ("long", "round")]
    data = vg.Study(base=given, axes={"shape.0.model": names}).run(tmp_path / "out", workers=1).dataset
    assert list(data["shape.0.model"].values) == names


def row_of(count):
    """Return spheres in a row, in a box three diameters wide, of which no twin is so loose."""
    place = [(k + 0.5, 0.5, 0.5) for k in range(count)]
    return vg.Packing.of([vg.shapes.sphere()], vg.Box((count, 3, 3)), position=place)


def cut():
    """Return labels of which the border cuts all."""
    image = np.zeros((10, 10, 10), dtype=np.int32)
    image[:3, :3, :3], image[5:, 5:9, 5:9] = 1, 2
    return vg.packing_of_labels(image, voxel_size=1.0, surface="voxel", gravity="none")


def one_shape():
    """Return a packing of one mesh many times."""
    rock = vg.make_shape("convex_polyhedron")
    shape = vg.Shape.from_mesh(rock.vertices, rock.faces)
    place = np.indices((3, 2, 2)).reshape(3, -1).T * 1.4 + 0.7
    return vg.Packing.of([shape], vg.Box((4.2, 2.8, 2.8)), position=place)


@pytest.mark.parametrize(
    ("sample", "more", "told"),
    [
        (lambda: row_of(12), {}, "rigid grains"),
        (lambda: row_of(5), {}, "10 at least"),
        (cut, {}, "no whole grain"),
        (one_shape, {"twin": {"solid_fraction": 0.2}}, "rigid grains"),
        (one_shape, {"twin": {"solid_fraction": 1.5}}, "solid_fraction"),
        (one_shape, {"packing": {"method": "rsa"}}, r"leave \[packing\] out"),
        (one_shape, {"shape": [{"family": "sphere"}]}, r"leave \[shape\] out"),
        (one_shape, {"twin": {"cuont": 3}}, "count"),
        (one_shape, {"twin": {"protocol": "poured"}}, "protocol"),
        (one_shape, {"twin": {"model": "none.nc"}}, r"none\.nc"),
        (one_shape, {"twin": {"forms": 0}}, "forms"),
        (one_shape, {"twin": {"solid_fraction": 0.5}, "scene": {"unit": "m"}}, "that of its sample"),
    ],
)
def test_bad_twins_are_refused_by_scene_and_prompt(sample, more, told, tmp_path, capsys):
    vg.save(sample(), tmp_path / "scan.vtp")
    given = {"twin": {"sample": "scan.vtp"} | more.get("twin", {})}
    given |= {key: value for key, value in more.items() if key != "twin"}
    with pytest.raises(VoxgranError, match=told):
        vg.Scene.from_mapping(given, folder=tmp_path)


def test_one_shape_is_refused_before_it_is_packed(tmp_path, capsys):
    vg.save(one_shape(), tmp_path / "scan.vtp")
    (tmp_path / "scene.toml").write_text('twin = {sample = "scan.vtp", solid_fraction = 0.5}')
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out")]) == 2
    assert "one shape" in capsys.readouterr().err
    assert main(["twin", str(tmp_path / "scan.vtp"), "-o", str(tmp_path / "twin"), "--solid-fraction", "0.5"]) == 2
    said = capsys.readouterr().err
    assert "one shape" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "twin").exists()
