"""Input for block codes: the JSON file, its schema, its polyhedra, and the partition into convex parts."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from engine_cases import assert_holds, dumbbell, falling, mixed, rocks, two_spheres
from kit import slow

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.convex_parts import FLAT, convex_parts
from voxgran.decks.engines import blocks
from voxgran.shapes.boolean import united
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.tessellate import unit_box

ROOT = Path(__file__).parents[3]
DOCS, DATA = ROOT / "docs" / "guide" / "decks_blocks.md", ROOT / "data"
TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": (int, float)}


def breaches(value, schema, place="$"):
    """Yield where a value is not as a schema has it; the words of JSON Schema that the schema of blocks uses."""
    assert set(schema) <= {
        *("$schema", "title", "type", "properties", "required", "additionalProperties", "items", "minItems"),
        *("maxItems", "minimum", "enum", "const"),
    }
    kind = TYPES[schema["type"]]
    if not isinstance(value, kind) or (isinstance(value, bool) and schema["type"] != "boolean"):
        yield f"{place} is no {schema['type']}"
        return
    if "const" in schema and value != schema["const"]:
        yield f"{place} is not {schema['const']!r}"
    if "enum" in schema and value not in schema["enum"]:
        yield f"{place} is none of {schema['enum']}"
    if value is not None and "minimum" in schema and value < schema["minimum"]:
        yield f"{place} is too small"
    if isinstance(value, dict):
        yield from (f"{place} has no {name}" for name in schema["required"] if name not in value)
        yield from (f"{place} has {name}" for name in value if name not in schema["properties"])
        for name in set(value) & set(schema["properties"]):
            yield from breaches(value[name], schema["properties"][name], f"{place}.{name}")
    if isinstance(value, list):
        if not schema["minItems"] <= len(value) <= schema.get("maxItems", len(value)):
            yield f"{place} has {len(value)} items"
        for number, item in enumerate(value):
            yield from breaches(item, schema["items"], f"{place}[{number}]")


def deck(folder, packing, **asked):
    """Write a deck and return it, what its file holds, and the file."""
    made = vg.write_deck(packing, folder, "blocks", **asked)
    found = json.loads((folder / blocks.FILE).read_text())
    assert list(breaches(found, blocks.SCHEMA)) == []
    return made, blocks.registration.read(folder), found


def triangles(solid):
    """Return the triangles (f, 3, 3) of a solid, its polygons cut into fans."""
    points = np.array(solid["vertices"])
    fans = [(face[0], a, b) for face in solid["faces"] for a, b in itertools.pairwise(face[1:])]
    return points[np.array(fans)]


def moments(solids):
    """Return volume, centroid and inertia tensor at unit density of solids together."""
    meshes = [Mesh(t.reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3)) for t in map(triangles, solids)]
    volume = sum(mesh.volume for mesh in meshes)
    middle = sum(mesh.volume * mesh.centroid for mesh in meshes) / volume
    tensor = np.zeros((3, 3))
    for mesh in meshes:
        off = mesh.centroid - middle
        tensor += mesh.inertia + mesh.volume * (off @ off * np.eye(3) - np.outer(off, off))
    return volume, middle, tensor


def assert_closed(solid):
    """Check that each edge has one face on each side, and that faces are plane polygons of used corners."""
    edges = [edge for face in solid["faces"] for edge in zip(face, [*face[1:], face[0]], strict=True)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    assert {corner for face in solid["faces"] for corner in face} == set(range(len(solid["vertices"])))


def planes_of(solid):
    """Return unit normal and level of each face, by Newell's sum, and its area."""
    points = np.array(solid["vertices"])
    for face in solid["faces"]:
        ring = points[face] - points[face].mean(axis=0)
        normal = np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0) / 2
        area = np.linalg.norm(normal)
        if area == 0:
            # a triangle of a part without thickness has no plane
            continue
        yield normal / area, float(points[face].mean(axis=0) @ normal / area), area


def boxes(*given):
    """Return the union of boxes, each as its lengths and its center."""
    corners, faces = unit_box()[:2]
    meshes = [(corners * np.array(lengths) + np.array(center), faces) for lengths, center in given]
    return vg.Shape.from_mesh(*united(meshes), name="boxes")


@pytest.mark.parametrize("kind", [None, "convex_parts"])
def test_solids_have_the_true_mass_centroid_and_inertia(tmp_path, kind):
    made, held, found = deck(tmp_path, rocks(8), grains=kind)
    simulation = made.simulation
    assert_holds(held, simulation)
    assert sum(grain["mass"] for grain in found["grains"]) == pytest.approx(simulation.bodies.mass.sum())
    for k, grain in enumerate(found["grains"]):
        solids = grain.get("parts", [grain])
        for solid in solids:
            assert_closed(solid)
        volume, middle, tensor = moments(solids)
        density = simulation.bodies.assembly.density
        assert volume * density == pytest.approx(grain["mass"], rel=1e-9)
        np.testing.assert_allclose(middle, grain["centroid"], atol=1e-9 * simulation.diameter)
        np.testing.assert_allclose(
            density * tensor, simulation.bodies.inertia[k], rtol=0, atol=1e-8 * np.ptp(tensor) * density
        )


def test_coplanar_triangles_are_one_face(tmp_path):
    packing = falling(
        vg.pack(vg.make_shape("box", lengths=(1, 0.8, 0.6)), vg.Box((4, 4, 4)), "rsa", count=3, unit="mm")
    )
    _, _, found = deck(tmp_path, packing)
    for grain in found["grains"]:
        assert [len(face) for face in grain["faces"]] == [4] * 6
        assert len(grain["vertices"]) == 8


def test_faces_of_polyhedra_are_seen_counterclockwise_from_outside(tmp_path):
    _, _, found = deck(tmp_path, rocks(8))
    convex = [grain for grain in found["grains"] if grain["shape"].startswith("convex")]
    assert convex
    for grain in convex:
        points = np.array(grain["vertices"])
        size = np.ptp(points, axis=0).max()
        for normal, level, _ in planes_of(grain):
            assert (points @ normal - level).max() < 1e-9 * size
            assert (points @ normal - level).min() < -0.1 * size


@pytest.mark.parametrize("seed", [slow(1), 3, 9, slow(24)])
def test_convex_parts_are_convex_and_fill_the_solid(tmp_path, seed):
    shape = vg.make_shape("solid_union", seed=seed)
    packing = vg.Packing.of(shape, vg.Box((3, 3, 3)), position=[[1.5, 1.5, 1.5]], unit="mm", gravity=(0, 0, -1))
    _, _, found = deck(tmp_path, packing, grains="convex_parts")
    (grain,) = found["grains"]
    size = 1e-3 * np.ptp(shape.vertices, axis=0).max()
    for part in grain["parts"]:
        points = np.array(part["vertices"])
        for normal, level, area in planes_of(part):
            # a face of no area has no plane
            if area > 1e-6 * size**2:
                assert (points @ normal - level).max() < 2 * FLAT * size
        assert len(part["faces"]) >= 4
    assert moments(grain["parts"])[0] == pytest.approx(1e-9 * shape.volume, rel=1e-9)


def test_parts_of_simple_solids():
    assert len(convex_parts(vg.make_shape("box"))) == 1
    corner = boxes(((2, 1, 1), (1, 0.5, 0.5)), ((1, 2, 1), (0.5, 1, 0.5)))
    assert sorted(round(part.volume, 9) for part in convex_parts(corner)) in ([1, 2], [2, 1])
    cross = boxes(((3, 1, 1), (0, 0, 0)), ((1, 3, 1), (0, 0, 0)), ((1, 1, 3), (0, 0, 0)))
    parts = convex_parts(cross)
    assert len(parts) <= 7
    assert sum(part.volume for part in parts) == pytest.approx(7, rel=1e-12)
    ring = boxes(*(((3, 1, 1), (0, y, 0)) for y in (-1, 1)), *(((1, 3, 1), (x, 0, 0)) for x in (-1, 1)))
    parts = convex_parts(ring)
    assert len(parts) == 4
    assert sum(part.volume for part in parts) == pytest.approx(8, rel=1e-12)


def test_parts_of_a_solid_do_not_overlap():
    shape = vg.make_shape("solid_union", seed=2)
    parts = convex_parts(shape)
    assert len(parts) > 5
    vertices, faces = united((part.vertices.copy(), part.faces) for part in parts)
    assert Mesh(vertices, faces).volume == pytest.approx(shape.volume, rel=1e-9)
    assert sum(part.volume for part in parts) == pytest.approx(shape.volume, rel=1e-10)


def test_a_union_of_spheres_has_one_part_for_each(tmp_path):
    shape = dumbbell()
    parts = convex_parts(shape)
    assert len(parts) == 3
    volume = sum(part.volume for part in parts)
    assert volume == pytest.approx(Mesh(shape.vertices, shape.faces).volume, rel=1e-5)
    assert volume == pytest.approx(shape.volume, rel=3e-3)
    united_volume = Mesh(*united((part.vertices.copy(), part.faces) for part in parts)).volume
    assert united_volume == pytest.approx(volume, rel=1e-9)
    made, held, found = deck(tmp_path, mixed(4), grains="convex_parts")
    assert_holds(held, made.simulation)
    assert {len(grain["parts"]) for grain in found["grains"]} == {1, 3}


def test_the_head_of_the_file(tmp_path):
    made, _, found = deck(tmp_path, rocks(), material={"restitution": 0.4})
    simulation = made.simulation
    assert found["comments"][0] == simulation.header("block codes")[0]
    assert found["law"]["stiffness"] == simulation.law.stiffness
    assert found["law"]["restitution"] == 0.4
    assert found["gravity"] == [0, 0, -9.81]
    assert found["time"]["step"] == simulation.time_step
    assert {shape["name"]: shape["kind"] for shape in found["shapes"]} == {
        one.name: one.kind for one in simulation.bodies.templates
    }
    middle = simulation.walls.bounds.mean(axis=0)
    assert len(found["container"]["planes"]) == 6
    for plane in found["container"]["planes"]:
        assert np.dot(middle - plane["point"], plane["normal"]) > 0


def test_round_walls_periodic_axes_and_walls_of_triangles(tmp_path):
    _, _, found = deck(tmp_path / "cylinder", mixed(2, container=vg.Cylinder(3, 7)), clump=None)
    assert found["container"]["round"]["kind"] == "cylinder"
    assert found["container"]["round"]["radius"] == pytest.approx(3e-3)
    _, _, found = deck(tmp_path / "periodic", mixed(2, periodic=True))
    assert found["container"]["periodic"] == [True] * 3
    room = vg.ClosedMesh(boxes(((5, 5, 5), (0, 0, 0))))
    _, _, found = deck(tmp_path / "mesh", mixed(2, container=room))
    assert_closed(found["container"]["mesh"])


def test_flat_grains_are_outlines(tmp_path):
    shapes = [vg.make_shape("disk"), vg.make_shape("polygon", seed=1)]
    packing = vg.pack(shapes, vg.Rectangle((6, 6)), "rsa", count=6, seed=1, unit="mm")
    made, held, found = deck(tmp_path, packing)
    assert_holds(held, made.simulation)
    assert found["dimension"] == 2
    assert len(found["container"]["planes"]) == 4
    assert found["comments"][-1] == "flat: masses are those of a metre of thickness"
    for grain in found["grains"]:
        assert "faces" not in grain
        x, y = np.array(grain["vertices"]).T
        area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)
        allowed = 1e-2 if grain["shape"].startswith("disk") else 1e-9
        assert area * made.simulation.bodies.assembly.density == pytest.approx(grain["mass"], rel=allowed)


@pytest.mark.slow
def test_many_rocks_are_written_in_seconds(tmp_path):
    shapes = [vg.make_shape("solid_union", seed=seed) for seed in (1, 2, 3)]
    grid = np.stack(np.meshgrid(*[np.arange(7)] * 3), axis=-1).reshape(-1, 3) * 3.0 + 1.5
    packing = vg.Packing.of(
        shapes, vg.Box((21, 21, 21)), position=grid, shape_id=np.arange(343) % 3, unit="mm", gravity=(0, 0, -1)
    )
    made = vg.write_deck(packing, tmp_path, "blocks", grains="convex_parts")
    assert made.simulation.bodies.count == 343
    # one line for each grain, beside those of the head
    assert len((tmp_path / blocks.FILE).read_text().splitlines()) < 343 + 20


def test_refusals(tmp_path):
    with pytest.raises(InputError, match="more than 300 convex parts"):
        convex_parts(vg.load_shape(DATA / "itokawa_lp.obj"))
    with pytest.raises(InputError, match="convex parts need a solid"):
        convex_parts(vg.make_shape("sheet"))
    flat = vg.pack(vg.make_shape("polygon", seed=1), vg.Rectangle((6, 6)), "rsa", count=2, seed=1, unit="mm")
    with pytest.raises(InputError, match="is flat: convex parts are those of solids"):
        vg.write_deck(flat, tmp_path, "blocks", grains="convex_parts")
    with pytest.raises(InputError, match="has 'polyhedron', 'mesh', 'convex_parts'"):
        vg.write_deck(rocks(), tmp_path, "blocks", grains="clump")
    with pytest.raises(InputError, match="not convex"):
        vg.write_deck(rocks(), tmp_path, "blocks", grains="polyhedron")


def test_other_engines_refuse_convex_parts(tmp_path):
    with pytest.raises(InputError, match="grains is 'convex_parts'"):
        vg.write_deck(two_spheres(), tmp_path, "lammps", grains="convex_parts")


def test_the_reader_refuses_another_format(tmp_path):
    (tmp_path / blocks.FILE).write_text('{"format": "other"}')
    with pytest.raises(FileFormatError, match="voxgran blocks 1"):
        blocks.registration.read(tmp_path)


def test_the_schema_refuses_what_it_does_not_name(tmp_path):
    _, _, found = deck(tmp_path, rocks())
    assert list(breaches(found | {"more": 1}, blocks.SCHEMA)) == ["$ has more"]
    found["grains"][0]["mass"] = "heavy"
    del found["law"]["friction"]
    assert sorted(breaches(found, blocks.SCHEMA)) == ["$.grains[0].mass is no number", "$.law has no friction"]


def test_the_page_names_every_member_of_the_file():
    text = DOCS.read_text()

    def members(schema):
        """Yield the names of all members of a schema."""
        for name, inner in schema.get("properties", {}).items():
            yield name
            yield from members(inner)
        yield from members(schema["items"]) if "items" in schema else ()

    assert not [name for name in members(blocks.SCHEMA) if f"`{name}`" not in text]
