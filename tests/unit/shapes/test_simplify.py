"""Simplification: fewer triangles, the same volume, and distances that are those of the surfaces."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import CallError, InputError, UnknownNameError
from voxgran.shapes.repairing.diagnose import diagnose
from voxgran.shapes.repairing.simplify import distances
from voxgran.shapes.tessellate import sphere, unit_box


def fine_sphere(level=5):
    vertices, faces, _ = sphere(level)
    return vg.Shape.from_mesh(vertices, faces, name="sphere")


@pytest.mark.slow
def test_the_error_of_a_sphere_falls_with_the_number_of_faces():
    """Areas and distances of the best surfaces of n triangles differ by amounts proportional to 1 / n."""
    numbers = np.array([100, 400, 1600])
    made = [vg.simplify(fine_sphere(), faces=int(n)) for n in numbers]
    for error in ([abs(one.collapse_volume_change) for one in made], [one.mean_distance for one in made]):
        rate = -np.polyfit(np.log(numbers), np.log(error), 1)[0]
        assert rate == pytest.approx(1.0, abs=0.25)
    assert [one.faces for one in made] == numbers.tolist()


@pytest.mark.parametrize("name", ["eros.obj", "itokawa_lp.obj", "bennu_lp.obj"])
@pytest.mark.parametrize("faces", [50, 200, 1000])
def test_scans(data_dir, name, faces):
    scan = vg.load_shape(data_dir / name)
    made = vg.simplify(scan, faces=faces)
    assert 0.95 * faces <= made.faces == len(made.shape.faces) <= faces
    assert made.faces_before == len(scan.faces) == made.shape.record["simplified_from"]
    assert diagnose(made.shape).ok
    assert made.shape.volume == pytest.approx(scan.volume, rel=1e-12)
    assert abs(made.volume_change) < 1e-12 < abs(made.collapse_volume_change)
    assert made.area_change == pytest.approx(made.shape.surface_area / scan.surface_area - 1)
    assert made.largest_distance < 2.5 * scan.diameter * faces**-0.75
    # the surface stays in its place
    shift = np.array(made.shape.offset) - np.array(scan.offset)
    back = np.abs(scan.signed_distance(made.shape.vertices + shift)).max()
    assert 0 < back <= made.largest_distance * (1 + 1e-12)


def test_distances_of_cubes():
    vertices, faces, _ = unit_box()
    mean, largest = distances(vertices, faces, 1.5 * vertices, faces)
    half = np.ptp(vertices, axis=0).max() / 2
    assert largest == pytest.approx(0.5 * half * 3**0.5, rel=1e-12)
    assert 0.5 * half < mean < largest


def test_a_cube_stays_exact():
    box = vg.shapes.box(lengths=(1.1, 1.3, 1.7))
    fine = vg.Shape.from_mesh(*_halved(*_halved(box.vertices, box.faces)))
    assert len(fine.faces) == 192
    made = vg.simplify(fine, faces=12)
    assert made.faces == 12
    assert made.collapse_volume_change == pytest.approx(0, abs=1e-12)
    assert made.largest_distance < 1e-12


def _halved(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    p, q, r = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = ((a, p, r), (p, b, q), (r, q, c), (p, q, r))
    return _joined(np.concatenate([np.stack(part, axis=1) for part in parts]))


def _joined(triangles):
    points, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return points, index.reshape(-1, 3)


def test_few_faces_come_back_unchanged():
    cube = vg.shapes.box(lengths=(1, 2, 3))
    made = vg.simplify(cube, faces=12)
    assert made.shape is cube
    assert (made.faces_before, made.faces, made.largest_distance, made.sentences) == (12, 12, 0.0, ())


def test_the_record_has_no_roughness_of_the_surface_before():
    stone = vg.roughen(vg.shapes.sphere(), rms=0.02, seed=1)
    made = vg.simplify(stone, faces=300).shape
    assert any(key.startswith("roughness_") for key in stone.record)
    assert made.record["simplified_from"] == len(stone.faces)
    assert not any(key.startswith("roughness_") for key in made.record)


@pytest.mark.parametrize("factor", [2.0**-100, 2.0**100])
def test_tiny_and_huge_units(factor):
    ring = vg.make_shape("torus")
    one, other = vg.simplify(ring, faces=300), vg.simplify(ring.scaled(factor), faces=300)
    assert (one.shape.faces == other.shape.faces).all()
    assert other.shape.vertices / factor == pytest.approx(one.shape.vertices, abs=1e-12)
    assert other.largest_distance == pytest.approx(factor * one.largest_distance, rel=1e-9)


def test_what_cannot_be_simplified():
    ring = vg.make_shape("torus")
    for faces in (3, 10.5, "many", True):
        with pytest.raises(InputError, match=r"faces is .*: it must be a whole number, at least 4"):
            vg.simplify(ring, faces=faces)
    with pytest.raises(InputError, match="flat"):
        vg.simplify(vg.make_shape("disk"), faces=10)
    with pytest.raises(InputError, match="open surface"):
        vg.simplify(vg.make_shape("sheet"), faces=10)
    with pytest.raises(InputError, match="must be a Shape"):
        vg.simplify(3, faces=10)
    sponge = vg.make_shape("sierpinski_sponge", kind="menger", levels=2)
    with pytest.raises(InputError, match=r"faces is 20: no closed surface .* which has 2112; give") as caught:
        vg.simplify(sponge, faces=20)
    enough = int(str(caught.value).rpartition(" ")[2])
    assert vg.simplify(sponge, faces=enough).faces <= enough
    with pytest.raises(InputError, match="no closed surface"):
        vg.simplify(sponge, faces=int(0.85 * enough))


def test_calls_that_do_not_fit_are_explained():
    ring = vg.make_shape("torus")
    with pytest.raises(CallError, match=r"did you mean 'faces'.*write simplify\(shape, faces=500\)"):
        vg.simplify(ring, face=100)
    with pytest.raises(CallError, match=r"write simplify\(shape, faces=500\)"):
        vg.simplify(ring)


def test_a_file_is_read(tmp_path):
    vg.save_shape(vg.make_shape("torus"), tmp_path / "ring.ply")
    assert vg.simplify(tmp_path / "ring.ply", faces=500).faces == 500


def scene(**shape):
    return vg.Scene.from_mapping(
        {"shape": [shape], "container": {"kind": "box", "lengths": [9, 9, 9]}, "packing": {"method": "rsa", "count": 2}}
    )


def test_the_key_of_a_scene():
    made = scene(family="torus", faces=200)
    assert "reduce 1 of the shapes to at most 200 triangles" in str(made.plan())
    assert len(made.shapes[0].make()[0].faces) == 200
    assert made.shapes[0].to_mapping()["faces"] == 200
    with pytest.raises(InputError, match=r"\[\[shape\]\] faces is 2"):
        scene(family="torus", faces=2)


def test_an_unknown_key_lists_those_of_every_shape():
    with pytest.raises(UnknownNameError, match="known are clump, count, density, diameter, faces, material, radius"):
        scene(family="sphere", foo=3)
