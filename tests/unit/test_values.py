"""Every number that a user may give, with values that break naive code: one sentence, or a result."""

import itertools
import os
import subprocess
import sys
import typing
import warnings
from collections.abc import Mapping
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.config import from_mapping, parameters_of
from voxgran._base.errors import VoxgranError
from voxgran.cli import main
from voxgran.clumps.method import clump_registry
from voxgran.io.cloud_files import cloud_of_packing
from voxgran.measures.registered.coordination import coordination_number, near_contacts
from voxgran.measures.registered.profile import axis_profile, wall_profile
from voxgran.packing.draw import Request
from voxgran.packing.method import method_registry
from voxgran.packing.pack import prepare_task
from voxgran.points.control import inner_points, sample_controls
from voxgran.shapes.family import families
from voxgran.shapes.size_laws.simple import Discrete

VALUES = {
    "10**400": 10**400,
    "-10**400": -(10**400),
    "10**5000": 10**5000,
    "5e-324": 5e-324,
    "1e308": 1e308,
    "-1e308": -1e308,
    "nan": float("nan"),
    "inf": float("inf"),
    "True": True,
    "'1'": "1",
    "Decimal(1)": Decimal(1),
    "Decimal(sNaN)": Decimal("sNaN"),
    "Decimal(1e400)": Decimal("1e400"),
    "Fraction(1)": Fraction(1),
    "Fraction(10**400)": Fraction(10**400),
    "float32(1)": np.float32(1),
    "int8(1)": np.int8(1),
    "array(1.0)": np.array(1.0),
    "array([1.0])": np.array([1.0]),
    "array(True)": np.array(True),
    "1j": 1j,
    "None": None,
    "dict": {},
}
#: all of these are the number 1
ONES = ("Decimal(1)", "Fraction(1)", "float32(1)", "int8(1)", "array(1.0)")
#: none of these is a number
NO_NUMBERS = ("True", "'1'", "array(True)", "1j", "array([1.0])", "dict")

BALL, BOX = vg.make_shape("sphere"), vg.Box((4, 4, 4))
ROCK = vg.Shape.of(vg.make_shape("box").geometry, name="rock")
PACKING = vg.Packing.of([BALL], BOX, position=[(1, 1, 1), (3, 3, 3)])
MASK = np.zeros((6, 6, 6), dtype=bool)
MASK[1:4, 2:5, 2:4] = True
CLOUD = vg.Cloud.of(np.random.Generator(np.random.Philox(1)).random((60, 3)))
TRIANGLES = (ROCK.vertices, ROCK.faces)


def outcome(call, value):
    """Return "done" or the message of a refusal; anything else that is raised, and warnings, go through."""
    try:
        with warnings.catch_warnings(action="error"):
            warnings.simplefilter("ignore", UserWarning)
            call(value)
    except VoxgranError as error:
        said = str(error)
    else:
        return "done"
    assert len(said) < 300, said
    assert "\n" not in said
    return said


def used(container):
    """Ask a container for all that it tells."""
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        assert container.volume > 0
        assert np.isfinite(container.bounds).all()
        container.signed_distance(np.zeros((1, 3)))
        container.mesh()
        container.scaled(2.0)
        vg.make_container(container.to_mapping())


def drawn(law):
    """Ask a size distribution for all that it tells."""
    law.quantile([0.0, 0.5, 1.0])
    law.cumulative([1.0])
    law.sample(3, np.random.Generator(np.random.Philox(1)))
    law.mean_volume()
    vg.sizes.make_sizes(law.to_mapping())


SINGLE = {
    "Box": lambda v: used(vg.Box((v, 4, 4))),
    "Rectangle": lambda v: used(vg.Rectangle((v, 4))),
    "Cylinder radius": lambda v: used(vg.Cylinder(v, 4)),
    "Cylinder height": lambda v: used(vg.Cylinder(4, v)),
    "Sphere": lambda v: used(vg.Sphere(v)),
    "Box origin": lambda v: used(vg.Box((4, 4, 4), origin=(v, 0, 0))),
    "Rectangle origin": lambda v: used(vg.Rectangle((4, 4), origin=(v, 0))),
    "Cylinder origin": lambda v: used(vg.Cylinder(4, 4, origin=(v, 0, 0))),
    "Sphere origin": lambda v: used(vg.Sphere(4, origin=(v, 0, 0))),
    "Box scaled": lambda v: used(BOX.scaled(v)),
    "Cylinder scaled": lambda v: used(vg.Cylinder(1, 1).scaled(v)),
    "make_container": lambda v: used(vg.make_container({"kind": "cylinder", "radius": v, "height": 1})),
    "fixed": lambda v: drawn(vg.sizes.fixed(v)),
    "lognormal median": lambda v: drawn(vg.sizes.lognormal(v, 0.2)),
    "lognormal sigma": lambda v: drawn(vg.sizes.lognormal(1.0, v)),
    "lognormal low": lambda v: drawn(vg.sizes.lognormal(1.0, 0.2, low=v)),
    "lognormal high": lambda v: drawn(vg.sizes.lognormal(1.0, 0.2, high=v)),
    "lognormal cut": lambda v: drawn(vg.sizes.lognormal(1.0, v, low=0.5, high=2.0)),
    "uniform low": lambda v: drawn(vg.sizes.uniform(v, 2.0)),
    "uniform high": lambda v: drawn(vg.sizes.uniform(0.5, v)),
    "discrete diameter": lambda v: drawn(vg.sizes.discrete([0.5, v], [1, 2])),
    "discrete weight": lambda v: drawn(vg.sizes.discrete([0.5, 1], [v, 2])),
    "sieve opening": lambda v: drawn(vg.sizes.sieve([0.5, v], [0, 1])),
    "sieve passing": lambda v: drawn(vg.sizes.sieve([0.5, 1.0, 2.0], [0, v, 1])),
    "make_sizes": lambda v: drawn(vg.sizes.make_sizes({"kind": "discrete", "diameters": [v], "weights": [1]})),
    "sizes.sample": lambda v: vg.sizes.fixed().sample(v, np.random.Generator(np.random.Philox(1))),
    "Shape.scaled": lambda v: ROCK.scaled(v).volume,
    "make_shape seed": lambda v: vg.make_shape("solid_union", seed=v),
    "from_mesh": lambda v: vg.Shape.from_mesh([[v, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], ROCK.faces[:4]),
    "Packing density": lambda v: vg.Packing.of([BALL], BOX, position=[(1, 1, 1)], density=v),
    "Packing scale": lambda v: vg.Packing.of([BALL], BOX, position=[(1, 1, 1)], scale=[v]).solid_fraction,
    "Packing position": lambda v: vg.verify(vg.Packing.of([BALL], BOX, position=[(v, 1, 1)])),
    "contacts": lambda v: PACKING.contacts(v),
    "verify": lambda v: vg.verify(PACKING, tolerance=v),
    "voxelize": lambda v: vg.voxelize(ROCK, voxel_size=v),
    "voxelize_mesh": lambda v: vg.voxelize_mesh(*TRIANGLES, voxel_size=v),
    "signed_distance voxel_size": lambda v: vg.signed_distance(ROCK, voxel_size=v),
    "signed_distance band": lambda v: vg.signed_distance(ROCK, voxel_size=0.5, band=v),
    "to_image": lambda v: vg.to_image(PACKING, v),
    "sample_surface": lambda v: vg.sample_surface(BALL, spacing=v),
    "sample_surface seed": lambda v: vg.sample_surface(BALL, spacing=0.5, seed=v),
    "dilation": lambda v: vg.dilation(MASK, v),
    "opening": lambda v: vg.opening(MASK, v),
    "distance_transform": lambda v: vg.distance_transform(MASK, threads=v),
    "distance_transform voxel_size": lambda v: vg.distance_transform(MASK, voxel_size=(1.0, v, 1.0)),
    "connected_components": lambda v: vg.connected_components(MASK, connectivity=v),
    "resample factor": lambda v: vg.resample(MASK, factor=v),
    "resample shape": lambda v: vg.resample(MASK, shape=(v, 2, 2)),
    "crop": lambda v: vg.crop(MASK, margin=v),
    "segment threshold": lambda v: vg.segment(MASK * 100.0, threshold=v),
    "segment min_size": lambda v: vg.segment(MASK * 100.0, threshold=50, min_size=v),
    "segment separation": lambda v: vg.segment(MASK * 100.0, threshold=50, min_size=1, separation=v),
    "iso_surface level": lambda v: vg.iso_surface(MASK, level=v),
    "iso_surface volume": lambda v: vg.iso_surface(MASK, volume=v),
    "load_labels": lambda v: vg.load_labels(MASK.astype(int), voxel_size=v),
    "load_labels three": lambda v: vg.load_labels(MASK.astype(int), voxel_size=(v, 1, 1)),
    "load_labels smoothing": lambda v: vg.load_labels(MASK.astype(int), voxel_size=1, smoothing=v),
    "load_outlines pixel_size": lambda v: vg.load_outlines(MASK[2].astype(int), pixel_size=v, min_area=1),
    "load_outlines min_area": lambda v: vg.load_outlines(MASK[2].astype(int), min_area=v),
    "load_outlines level": lambda v: vg.load_outlines(MASK[2] * 1.0, level=v, min_area=1),
    "repair": lambda v: vg.repair(*TRIANGLES, max_hole=v),
    "cloud thinned": lambda v: CLOUD.thinned(v),
    "cloud outliers": lambda v: CLOUD.without_outliers(v),
    "cloud neighbours": lambda v: CLOUD.without_outliers(neighbours=v),
    "cloud normals": lambda v: CLOUD.with_normals(v),
    "cloud clusters": lambda v: CLOUD.clusters(v),
    "cloud min_points": lambda v: CLOUD.clusters(0.1, min_points=v),
    "cloud cropped": lambda v: CLOUD.cropped((0, 0, 0), (1, 1, v)),
    "shape_of_cloud depth": lambda v: vg.shape_of_cloud(CLOUD, depth=v),
    "shape_of_cloud alpha": lambda v: vg.shape_of_cloud(CLOUD, method="alpha", alpha=v),
    "shape_of_cloud hole": lambda v: vg.shape_of_cloud(CLOUD, max_gap=v),
    "register_clouds": lambda v: vg.register_clouds(CLOUD, CLOUD, distance=v),
    "register_clouds seed": lambda v: vg.register_clouds(CLOUD, CLOUD, distance=0.1, seed=v),
    "deform stiffness": lambda v: vg.deform(PACKING, stiffness=v, spacing=0.3),
    "deform spacing": lambda v: vg.deform(PACKING, spacing=v),
    "deform reach": lambda v: vg.deform(PACKING, spacing=0.3, reach=v),
    "grow": lambda v: vg.grow(PACKING, max_factor=v),
    "inscribe": lambda v: vg.inscribe(PACKING, ROCK, seed=v),
    "inscribe weights": lambda v: vg.inscribe(PACKING, [ROCK, ROCK], weights=[v, 1]),
    "window": lambda v: vg.window_solid_fraction(PACKING, (0, 0, 0), (1, 1, v)),
    "near_contacts": lambda v: near_contacts(PACKING, v),
    "coordination_number": lambda v: coordination_number(PACKING, [v]),
    "axis_profile": lambda v: axis_profile(PACKING, bins=v),
    "wall_profile": lambda v: wall_profile(PACKING, step=v),
    "save_cloud": lambda v: cloud_of_packing(PACKING, v),
    "sample_controls": lambda v: sample_controls(ROCK, spacing=v),
    "inner_points": lambda v: inner_points(ROCK, spacing=v),
    "fit_clump spheres": lambda v: vg.fit_clump(ROCK, max_spheres=v),
    "fit_clump value": lambda v: vg.fit_clump(ROCK, max_spheres=2, target="iou", value=v),
    "fit_clump seed": lambda v: vg.fit_clump(ROCK, max_spheres=2, seed=v),
    "scene seed": lambda v: scene(scene={"seed": v}),
    "scene seeds": lambda v: scene(scene={"seeds": v}),
    "scene density": lambda v: scene(scene={"density": v}),
    "scene share": lambda v: scene(shape=[{"family": "sphere", "share": v}]),
    "scene count": lambda v: scene(packing={"method": "rsa", "count": v}),
    "scene solid_fraction": lambda v: scene(packing={"method": "rsa", "solid_fraction": v}),
    "scene sizes": lambda v: scene(sizes={"kind": "fixed", "diameter": v}),
    "scene lengths": lambda v: scene(container={"kind": "box", "lengths": [v, 4, 4]}),
    "scene snapshots": lambda v: scene(output={"snapshots": v}),
}
#: parts of `pack`, none of which packs: the grains are drawn and what was asked is checked
ASKED = {
    "count": lambda v: task(count=v),
    "solid_fraction": lambda v: task(solid_fraction=v),
    "seed": lambda v: task(seed=v),
    "weights": lambda v: task(weights=[v]),
    "sizes": lambda v: task(sizes=vg.sizes.fixed(v)),
    "box": lambda v: task(container=vg.Box((v, 4, 4))),
    "grain": lambda v: task(shapes=vg.make_shape("sphere", diameter=v)),
}


def scene(**sections):
    """Make a scene and its plan."""
    base = {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [4, 4, 4]},
        "packing": {"method": "rsa", "count": 2},
    }
    return vg.Scene.from_mapping({**base, **sections})


def task(shapes=BALL, container=BOX, **asked):
    """Check what `pack` is asked and draw the grains."""
    return prepare_task(Request(shapes, container, "rsa", **{"count": 2, **asked}))


def check_all(call, name):
    """Try all values; what is no number is refused, and one is one however it is written."""
    found = {key: outcome(call, value) for key, value in VALUES.items()}
    # a density may be a sequence, of one for each shape
    if name not in ("connectivity", "connected_components", "segment threshold", "Packing density"):
        assert "done" not in [found[key] for key in NO_NUMBERS], name
    plain = outcome(call, 1)
    for key in ONES:
        assert (found[key] == "done") == (plain == "done"), (key, plain)


@pytest.mark.parametrize("name", SINGLE)
def test_numbers_that_stand_alone(name):
    check_all(SINGLE[name], name)


@pytest.mark.parametrize("name", ASKED)
def test_numbers_that_pack_is_asked(name):
    check_all(ASKED[name], name)


def entries(registry):
    """Yield name, parameter class and parameter of all that takes numbers."""
    for name in registry.names():
        entry = registry.get(name)
        for item in parameters_of(entry.parameters):
            if numeric(item.type):
                yield name, entry.parameters, item


def numeric(kind):
    """Return whether a type is, or holds, a number."""
    return kind in (int, float) or any(numeric(part) for part in typing.get_args(kind))


def forms(item):
    """Yield functions that put a number into a parameter: as it is, and into each place of a list."""
    yield lambda v: v
    for kind in [item.type, *typing.get_args(item.type)]:
        if typing.get_origin(kind) is tuple and kind.__args__[-1] is not Ellipsis:
            many = len(kind.__args__)
            for k in range(many):
                yield lambda v, k=k, many=many: [*[1] * k, v, *[1] * (many - k - 1)]


#: of solids that take long to make, one parameter of several is quick enough
LONG = [("superspherize", "radii"), ("superspherize", "amounts"), ("sphere_assembly", "radii")]
FAMILIES = [slow(name, item) if (name, item.name) in LONG else (name, item) for name, _, item in entries(families())]


@pytest.mark.parametrize(("family", "item"), FAMILIES, ids=lambda one: getattr(one, "name", one))
def test_parameters_of_families(family, item):
    for form, (key, value) in itertools.product(forms(item), VALUES.items()):
        found = outcome(lambda v, form=form: vg.make_shape(family, **{item.name: form(v)}).volume, value)
        if key in NO_NUMBERS[:4]:
            assert found != "done", key


METHODS = [
    (name, cls, item) for registry in (method_registry(), clump_registry()) for name, cls, item in entries(registry)
]


@pytest.mark.parametrize(("method", "cls", "item"), METHODS, ids=lambda one: getattr(one, "name", str(one)))
def test_parameters_of_methods(method, cls, item):
    for form, (key, value) in itertools.product(forms(item), VALUES.items()):
        given: Mapping = {item.name: form(value)}
        found = outcome(lambda v: from_mapping(cls, v, method), given)
        if key in NO_NUMBERS[:4]:
            assert found != "done", key
        # whatever is not finite is refused, also where no bound is set
        if key in ("nan", "inf", "10**400", "Decimal(sNaN)"):
            assert found != "done", key


def test_one_is_one_in_parameter_classes():
    law = from_mapping(Discrete, {"diameters": [VALUES[key] for key in ONES], "weights": np.ones(5)}, "[sizes]")
    assert law == Discrete(diameters=(1.0,) * 5, weights=(1.0,) * 5)
    assert {type(value) for value in (*law.diameters, *law.weights)} == {float}


@pytest.mark.filterwarnings("ignore:the solid fraction is")
def test_a_packing_of_odd_numbers_is_that_of_plain_ones(tmp_path):
    plain = vg.pack(BALL, BOX, method="rsa", count=3, seed=1, solid_fraction=0.2, tries=50, time_limit=1000)
    odd = vg.pack(
        vg.make_shape("sphere", diameter=Fraction(1)),
        vg.Box((Decimal(4), np.float32(4), np.array(4.0))),
        method="rsa",
        count=Decimal(3),
        seed=np.int64(1),
        solid_fraction=Decimal("0.2"),
        tries=np.float64(50),
        time_limit=Decimal(1000),
    )
    vg.save(odd, tmp_path / "odd.vtp")
    again = vg.load(tmp_path / "odd.vtp")
    assert again.position.tobytes() == plain.position.tobytes()
    assert again.provenance["asked"] == plain.provenance["asked"]
    assert again.provenance["parameters"] == plain.provenance["parameters"]


#: results that hold a shape, and how it is had of each
HOLDING = {
    ".shape": (vg.repair(*TRIANGLES), vg.simplify(ROCK, faces=100)),
    ".to_shape()": (vg.fit_clump(ROCK, max_spheres=2),),
    "[0]": ((ROCK, "and what was done"),),
}
#: functions that take a shape
TAKING = {
    "pack": lambda held: vg.pack(held, BOX, "rsa", count=1),
    "pack a list": lambda held: vg.pack([BALL, held], BOX, "rsa", count=1),
    "Packing.of": lambda held: vg.Packing.of([held], BOX, position=[(1, 1, 1)]),
    "ClosedMesh": vg.ClosedMesh,
    "inscribe": lambda held: vg.inscribe(PACKING, [held]),
    "voxelize": lambda held: vg.voxelize(held, voxel_size=0.5),
    "signed_distance": lambda held: vg.signed_distance(held, voxel_size=0.5),
    "sample_surface": lambda held: vg.sample_surface(held, spacing=0.5),
    "fit_clump": vg.fit_clump,
    "roughen": lambda held: vg.roughen(held, rms=0.01),
    "simplify": lambda held: vg.simplify(held, faces=10),
    "spherize": lambda held: vg.spherize(held, 1.0),
    "describe": vg.describe,
    "save_shape": lambda held: vg.save_shape(held, "rock.stl"),
    "save_gallery": lambda held: vg.save_gallery([held], "rocks.png"),
    "plot": vg.plot,
}


@pytest.mark.parametrize("name", TAKING)
def test_results_that_hold_a_shape_are_told_how_it_is_had(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for remedy, results in HOLDING.items():
        for held in results:
            if isinstance(held, tuple) and name in ("pack", "inscribe", "describe"):
                # a tuple of shapes is a list of them
                continue
            with pytest.raises(VoxgranError) as found:
                TAKING[name](held)
            assert f"write {remedy} behind it" in str(found.value)
            assert len(str(found.value)) < 300


def test_a_closed_mesh_of_a_primitive_is_told_how_it_is_had():
    with pytest.raises(VoxgranError, match=r"is a primitive: .*from_mesh\(shape.vertices, shape.faces\)\), whose"):
        vg.ClosedMesh(BALL)
    with pytest.raises(VoxgranError, match="that bound a solid; take a solid"):
        vg.ClosedMesh(vg.make_shape("disk"))
    made = vg.ClosedMesh(vg.Shape.from_mesh(BALL.vertices, BALL.faces))
    assert made.volume == pytest.approx(BALL.volume, rel=0.01)


def test_a_dash_is_no_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "-"]) == 2
    assert "/dev/stdout" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_what_lies_below_a_mask_is_no_number():
    with pytest.raises(VoxgranError, match="nan at index"):
        BOX.signed_distance(np.ma.masked_all((2, 3)))
    with pytest.raises(VoxgranError, match="some values are masked"):
        vg.load_labels(np.ma.masked_less(MASK.astype(int), 1), voxel_size=1.0)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("NUMBA_NUM_THREADS", "0", "cannot be loaded"),
        slow("PYTHONWARNINGS", "error::UserWarning", "it ends the command, as PYTHONWARNINGS"),
    ],
)
def test_odd_environments_are_one_line(tmp_path, name, value, told):
    PACKING.save(tmp_path / "bed.vtp")
    command = [sys.executable, "-m", "voxgran", "measure", str(tmp_path / "bed.vtp"), "--which", "density"]
    done = subprocess.run(command, env={**os.environ, name: value}, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert told in done.stderr
