from dataclasses import replace

import numpy as np
import pytest
from kit import slow
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base.errors import PackingWarning
from voxgran.contacts.manifolds.convex_bodies import is_convex
from voxgran.scene.twins.sample import resolved, sample_of
from voxgran.scene.twins.twin import Twin
from voxgran.shapes.learning.sample import checked_sample
from voxgran.shapes.learning.steps import LABELS, without_steps
from voxgran.shapes.primitive import Primitive

VOXEL = 0.07
#: edges of voxels where the forms need not be right
COARSE = (0.11,) * 3


def sample_of_labels(shapes, edges=(VOXEL,) * 3):
    """Return the sample of the labels of 12 grains that do not touch, turned at random."""
    turn = np.random.default_rng(1).normal(size=(12, 4))
    place = 0.9 + 2.1 * np.argwhere(np.ones((3, 2, 2)))
    turn /= np.linalg.norm(turn, axis=1)[:, None]
    which = np.arange(12) % len(shapes)
    grains = vg.Packing.of(shapes, vg.Box((6.0, 3.9, 3.9)), position=place, orientation=turn, shape_id=which)
    return sample_of(vg.packing_of_labels(vg.to_image(grains, edges), voxel_size=edges, gravity="none"), 0.6)


def sphericity(shape):
    """Return the surface of the sphere of a solid's volume over its surface (Wadell 1932)."""
    return np.cbrt(np.pi) * (6 * shape.volume) ** (2 / 3) / shape.surface_area


def without(sample, faces=200):
    kind, made = without_steps(sample.shapes, sample.weights, faces)
    return None if kind == LABELS else made


@pytest.mark.parametrize(("semi_axes", "kind"), [((0.5, 0.5, 0.5), "sphere"), ((0.6, 0.5, 0.4), "ellipsoid")])
def test_labels_of_smooth_grains_are_these_again(semi_axes, kind):
    found = sample_of_labels([vg.make_shape("ellipsoid", semi_axes=semi_axes)])
    smooth = without(found)
    assert {shape.geometry.kind for shape in smooth} == {kind}
    assert {shape.unit for shape in smooth} == {found.shapes[0].unit}
    got = np.array([sorted(np.ptp(shape.bounds, axis=0)) for shape in smooth])
    assert got == pytest.approx(np.tile(sorted(2 * np.array(semi_axes)), (len(got), 1)), rel=0.03)
    volumes = [shape.volume for shape in found.shapes]
    assert [shape.volume for shape in smooth] == pytest.approx(volumes, rel=1e-6)


@pytest.mark.parametrize("kind", ["box", slow("convex_polyhedron")])
def test_labels_of_convex_grains_are_convex_with_few_faces(kind):
    """The sphericity of labels, of polyhedra 0.02 too low by their steps, is right within 0.01, and so are volumes."""
    shapes = [vg.make_shape(kind)] if kind == "box" else vg.make_shapes(kind, count=12, seed=2)
    found = sample_of_labels(shapes)
    made = without(found)
    true, labels, got = (np.mean([sphericity(one) for one in group]) for group in (shapes, found.shapes, made))
    assert abs(got - true) < 0.013 < abs(labels - true) + 0.005
    for shape, label in zip(made, found.shapes, strict=True):
        assert shape.volume == pytest.approx(label.volume, rel=1e-9)
        assert ConvexHull(shape.vertices).volume == pytest.approx(shape.volume, rel=1e-9)
        assert len(shape.faces) <= 64
    if kind == "box":
        assert [len(shape.faces) for shape in resolved(found, 200).shapes] == [len(shape.faces) for shape in made]
    else:
        assert max(len(shape.faces) for shape in without(found, 20)) <= 20


@pytest.mark.slow
def test_labels_of_grains_that_are_not_convex_stay_meshes():
    shapes = [vg.make_shape("torus"), *vg.make_shapes("convex_polyhedron", count=4, seed=2)]
    found = sample_of_labels(shapes, COARSE)
    assert without(found) is None
    assert len(resolved(found, 200).shapes) == len(found.shapes)


@pytest.mark.slow
def test_curved_convex_grains_keep_their_triangles():
    """With as few triangles as flat faces need, superquadrics had a sphericity 0.025 too low."""
    shapes = vg.make_shapes("superquadric", count=3, seed=2)
    made = without(sample_of_labels(shapes))
    true, got = (np.mean([sphericity(one) for one in group]) for group in (shapes, made))
    assert abs(got - true) < 0.012
    assert np.mean([len(one.faces) for one in made]) >= 64


@pytest.mark.slow
@pytest.mark.parametrize("kind", [slow("sphere"), "convex_polyhedron"])
def test_few_grains_that_are_quite_another_stay_as_they_are(kind):
    """A ring among eleven others is neither a sphere nor a hull; two of twelve are too many."""
    others = [vg.shapes.sphere()] * 11 if kind == "sphere" else vg.make_shapes(kind, count=11, seed=2)
    found = sample_of_labels([vg.make_shape("torus"), *others])
    made = without(found)
    rings = [not is_convex(one.geometry) for one in made]
    assert np.flatnonzero(rings).tolist() == [np.argmin([sphericity(one) for one in found.shapes])]
    assert [one.volume for one in made] == pytest.approx([one.volume for one in found.shapes], rel=1e-6)
    made = resolved(found, 200).shapes
    assert max(len(one.faces) for one in made if not isinstance(one.geometry, Primitive)) <= 200
    assert without(sample_of_labels([vg.make_shape("torus"), *others[:5]])) is None


def labels_of(*forms, surface="smooth"):
    """Return the sample of the voxels of forms, each of one label."""
    edge = max(max(one.shape) for one in forms) + 2
    image = np.zeros((edge * len(forms), edge, edge), dtype=np.int32)
    for k, one in enumerate(forms):
        image[edge * k + 1 :, 1:, 1:][tuple(map(slice, one.shape))] = (k + 1) * one
    return sample_of(vg.packing_of_labels(image, voxel_size=VOXEL, gravity="none", surface=surface), 0.6)


def test_a_flat_ring_is_not_convex_however_thin():
    """All of its surface is within half a voxel of the faces of its hull."""
    ring = np.ones((1, 9, 9), dtype=bool)
    ring[:, 1:-1, 1:-1] = False
    assert without(labels_of(*[ring] * 12)) is None


def test_nine_of_ten_grains_are_enough():
    round_ = np.linalg.norm(np.indices((9, 9, 9)) - 4.0, axis=0) < 4.4
    found = labels_of(*[round_] * 9, np.ones((3, 3, 9), dtype=bool))
    assert [isinstance(one.geometry, Primitive) for one in without(found)] == [True] * 9 + [False]


@pytest.mark.parametrize("surface", ["smooth", "voxel"])
@pytest.mark.parametrize("form", [(2, 5, 5), (3, 5, 5), (5, 5, 5)])
def test_so_few_triangles_that_bound_no_solid_are_not_taken(form, surface):
    """Collapses to four triangles left points in one plane, of which there is no hull, or many more triangles."""
    found = labels_of(*[np.ones(form, dtype=bool)] * 10, surface=surface)
    for faces in (4, 8, 20):
        made = without(found, faces)
        if made is not None:
            assert all(isinstance(one.geometry, Primitive) or len(one.faces) <= faces for one in made)
            assert [one.volume for one in made] == pytest.approx([one.volume for one in found.shapes], rel=1e-6)
    assert made is not None


@pytest.mark.parametrize(("kind", "form"), [("ellipsoid", (0.54, 0.5, 0.46)), ("convex", None)])
def test_steps_are_those_of_the_lattice_where_voxels_are_long(kind, form):
    """Distances were judged by the longest edge: of voxels 1 x 1 x 3 these ellipsoids were spheres."""
    few = [vg.make_shape("ellipsoid", semi_axes=form)] if form else vg.make_shapes("convex_polyhedron", count=3, seed=2)
    found = sample_of_labels(few, tuple(VOXEL * np.array((1.0, 1.0, 3.0)) / np.cbrt(3.0)))
    made = resolved(found, 200)
    assert made.kind == kind
    assert np.mean([sphericity(one) for one in made.shapes]) == pytest.approx(
        np.mean([sphericity(one) for one in few]), abs=0.007
    )
    assert [one.volume for one in made.shapes] == pytest.approx([one.volume for one in found.shapes], rel=1e-6)


@pytest.mark.filterwarnings("ignore:.*voxels .label 3 first")
def test_labels_of_few_voxels_do_not_say_what_the_others_are():
    """Specks are as near to a sphere as any, so that two rings among thirty of them were too few to count."""
    ring = np.ones((2, 9, 9), dtype=bool)
    ring[:, 2:-2, 2:-2] = False
    speck = np.ones((1, 1, 2), dtype=bool)
    assert without(labels_of(*[ring] * 2, *[speck] * 30)) is None
    assert without(labels_of(*[speck] * 10)) is not None


@pytest.mark.slow
def test_another_sample_is_of_the_kind_that_was_found(monkeypatch):
    """A twin is compared with other labels by `compared_with`, which chose for themselves."""
    found = sample_of_labels([vg.make_shape("ellipsoid", semi_axes=(0.5, 0.5, 0.5))], COARSE)
    assert (resolved(found, 200).kind, resolved(found, 200, "convex").kind) == ("sphere", "convex")
    assert resolved(found, 200, "labels").kind == "labels"
    monkeypatch.setattr("voxgran.scene.twins.twin.comparison_of", lambda sample, *_: sample)
    twin = Twin(sample=replace(resolved(found, 200, "convex"), solid_fraction=0.6), packings=())
    assert twin.compared_with(found.packing).kind == "convex"
    whole = [vg.Shape.from_mesh(one.vertices, one.faces) for one in vg.make_shapes("convex_polyhedron", count=12)]
    assert resolved(sample_of(whole, 0.6), 200, "sphere").kind is None


@pytest.mark.slow
def test_learning_from_labels_leaves_the_steps_out():
    """Only twins had done so: polyhedra that were drawn had thousands of triangles, and were not convex."""
    scan = sample_of_labels(vg.make_shapes("convex_polyhedron", count=12, seed=2), COARSE).packing
    for given in (vg.learn_shapes(scan, strength=0.05).shapes, checked_sample(scan.shapes[:10], None, None).shapes):
        assert all(is_convex(one.geometry) for one in given)
    # of spheres there is no distribution, but that of ellipsoids by which their labels differ
    round_ = sample_of_labels([vg.shapes.sphere()], (0.071, 0.073, 0.069)).packing
    assert np.mean([sphericity(one) for one in checked_sample(round_, None, None).shapes]) > 0.998


def torn(edge, seed=3):
    """Return voxels at random, of which no closed surface of few triangles is found."""
    return np.random.default_rng(seed).random((edge,) * 3) < 0.6


@pytest.mark.slow
def test_a_label_that_noise_has_torn_stops_no_twin():
    """It was refused by simplify, and with it the sample of a hundred good grains."""
    round_ = np.linalg.norm(np.indices((9, 9, 9)) - 4.0, axis=0) < 4.4
    with pytest.warns(PackingWarning, match="pieces"):
        found = labels_of(torn(9), *[round_] * 10)
    with pytest.warns(
        PackingWarning, match=r"1 of 11 grains \(label 1\) have no closed surface of at most 60"
    ) as caught:
        made = vg.twin(found.packing, solid_fraction=0.4, protocol="expand", count=12, faces=60).sample
    assert [len(one.faces) > 60 for one in made.shapes if one.name == "label 1"] == [True]
    assert [one.volume for one in made.shapes] == pytest.approx([one.volume for one in found.shapes], rel=1e-6)
    assert caught[0].filename == __file__
