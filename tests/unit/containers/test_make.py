import json

import numpy as np
import pytest

from voxgran._base.errors import CallError, DirtyMeshError, InputError, UnknownNameError
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.disk import Disk
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.polygon import Polygon
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.kinds.sphere import Sphere
from voxgran.containers.model import boundary_of, container_registry, make_container
from voxgran.shapes.model import Shape

CONTAINERS = [
    Box((8, 8, 14), periodic=["x", "y"], origin=(0.1, 0.2, 0.3)),
    Cylinder(1.5, 4, origin=(0, 0, 0.1)),
    Sphere(2.5, origin=(1, 2, 0.3)),
    Rectangle((3, 0.1), periodic=(False, True), origin=(0.7, 0.3)),
    Disk(2.5, origin=(1, 0.3)),
    Polygon([(0, 0), (6, 0.1), (6, 4), (3, 2.5), (0, 4)], holes=[[(2, 1), (3, 1), (3, 2)]]),
]


@pytest.mark.parametrize("container", CONTAINERS, ids=lambda c: c.kind)
def test_what_is_written_comes_back(container):
    assert make_container(json.loads(json.dumps(container.to_mapping()))) == container


def test_a_closed_mesh_comes_back_bit_for_bit(data_dir):
    container = ClosedMesh.from_file(data_dir / "bennu_lp.obj")
    again = make_container(json.loads(json.dumps(container.to_mapping())))
    assert isinstance(again, ClosedMesh)
    assert again.shape == container.shape
    assert again.shape.offset == container.shape.offset
    assert again.shape.name == container.shape.name


def test_a_mesh_is_made_from_a_file_or_from_arrays(data_dir, tmp_path):
    from_file = make_container({"kind": "mesh", "file": str(data_dir / "bennu_lp.obj")})
    vertices, faces = Box((1, 1, 1)).mesh()
    made = make_container({"kind": "mesh", "vertices": vertices.tolist(), "faces": faces.tolist()})
    assert from_file.kind == made.kind == "mesh"
    np.testing.assert_allclose(made.bounds, [[0, 0, 0], [1, 1, 1]], atol=1e-15)
    assert made.shape == Shape.from_mesh(vertices, faces)
    with pytest.raises(DirtyMeshError):
        make_container({"kind": "mesh", "vertices": vertices.tolist(), "faces": faces[1:].tolist()})
    open_file = tmp_path / "open.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces[1:] + 1]
    open_file.write_text("\n".join(lines))
    with pytest.raises(DirtyMeshError, match=r"; use vg\.repair, or 'voxgran repair' at the prompt$"):
        make_container({"kind": "mesh", "file": str(open_file)})


def test_axis_names_as_in_a_scene_file():
    assert make_container({"kind": "box", "lengths": [8, 8, 14], "periodic": ["x", "y"]}).periodic == (
        True,
        True,
        False,
    )


def test_all_kinds_are_listed():
    registry = container_registry()
    flat, plain = ("disk", "polygon", "rectangle"), ("box", "cylinder", "mesh", "sphere")
    assert registry.names() == tuple(sorted((*flat, *plain, "drum", "funnel", "hopper", "planes", "vessel", "walls")))
    entries = [registry.get(name) for name in registry.names()]
    # the space in a vessel is a closed mesh
    assert all(entry.container.kind == entry.name for entry in entries if entry.name != "vessel")
    assert registry.get("vessel").container is ClosedMesh
    assert entries[0].keys == {"lengths": True, "periodic": False, "origin": False, "tilt": False}


@pytest.mark.parametrize("container", CONTAINERS)
def test_the_boundary_is_that_of_the_signed_distance(container):
    """On flat walls, on the round wall and on the solid the distance is 0."""
    walls, (lower, upper) = boundary_of(container), container.bounds
    middle = (lower + upper) / 2
    for axis in np.flatnonzero(walls.flat):
        for end in (lower, upper):
            place = middle.copy()
            place[axis] = end[axis]
            assert container.signed_distance(place[None])[0] == pytest.approx(0, abs=1e-12)
    for wall in walls.round:
        place = np.array(wall.center) + wall.radius * np.array([0.6, 0.8, 0.0])
        place[2] += 0.0 if wall.axes == 3 else (upper - lower)[2] / 2
        assert container.signed_distance(place[None])[0] == pytest.approx(0, abs=1e-12)
    assert walls.is_flat == isinstance(container, Box | Rectangle)
    assert (walls.solid is not None) == isinstance(container, ClosedMesh | Polygon)


@pytest.mark.parametrize(
    ("mapping", "error", "message"),
    [
        ({"kind": "bx", "lengths": [1, 1, 1]}, UnknownNameError, "did you mean 'box'"),
        ({}, InputError, "kind is missing: it must be one of box"),
        ({"kind": []}, UnknownNameError, "known are box"),
        (3, InputError, "container. is 3: it must be a mapping"),
        ({"kind": "mesh", "file": 3}, InputError, "path is 3"),
        ({"kind": "box", "lengths": [1, 1, 1], "periodic": 3}, InputError, "periodic is 3"),
        ({"kind": "box", "lenghts": [1, 1, 1]}, UnknownNameError, "did you mean 'lengths'"),
        ({"kind": "box"}, InputError, "lengths is missing"),
        ({"kind": "cylinder", "radius": 1}, InputError, "height is missing"),
        ({"kind": "sphere"}, InputError, "radius is missing"),
        ({"kind": "mesh"}, InputError, "file is missing"),
        ({"kind": "box", "lengths": [1, 0, 1]}, InputError, "above 0"),
        ({"kind": "cylinder", "radius": True, "height": 1}, InputError, "must be a number"),
    ],
)
def test_what_is_wrong_is_named(mapping, error, message):
    with pytest.raises(error, match=message):
        make_container(mapping)


def test_a_unit_and_another_dimension_are_told_with_a_remedy():
    for container in (Box, Rectangle, Cylinder, Disk, Sphere, ClosedMesh, Polygon):
        with pytest.raises(CallError, match=r"'unit' is unknown: .*pack, .* take the unit"):
            container(unit="mm")
    with pytest.raises(UnknownNameError, match=r"'unit' is unknown: .*; a scene states its unit in \[scene\]"):
        make_container({"kind": "box", "lengths": [8, 8, 8], "unit": "mm"})
    with pytest.raises(InputError, match=r"lengths has shape \(2,\): .*; use a Rectangle"):
        Box((8, 30))
    with pytest.raises(InputError, match=r"lengths has shape \(3,\): .*; use a Box"):
        Rectangle((8, 30, 8))
