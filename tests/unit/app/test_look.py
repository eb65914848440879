"""The view of the app: grains, contacts and force chains, and a picked grain among the others and alone."""

import dataclasses
import itertools

import numpy as np
import pytest

import voxgran as vg
from voxgran.app.look import ALONE, CHAINS, CONTACTS, GRAINS, Look
from voxgran.report.stage import shot


@pytest.fixture
def look(bed):
    """Return a scene with the bed."""
    made = Look()
    made.show(bed)
    yield made
    made.stage.close()


def meshes(look):
    """Return the meshes that are drawn."""
    found = (getattr(getattr(actor, "mapper", None), "dataset", None) for actor in look.stage.actors.values())
    return [mesh for mesh in found if mesh is not None]


def test_a_grain_is_picked_in_the_picture():
    look = Look()
    shapes, place = [vg.make_shape("box"), vg.make_shape("sphere")], [[0.5, 0.5, 0.5], [2.5, 0.5, 0.5]]
    packing = vg.Packing.of(shapes, vg.Box((3, 1, 1)), position=place, shape_id=[0, 1])
    look.show(packing)
    look.stage.render()
    wide, high = look.stage.window_size
    for grain, point in enumerate(place):
        look.stage.renderer.SetWorldPoint(*point, 1)
        look.stage.renderer.WorldToDisplay()
        x, y, _ = look.stage.renderer.GetDisplayPoint()
        assert look.grain_at(x / wide, 1 - y / high) == grain
    assert look.grain_at(0.001, 0.001) is None
    look.stage.close()


def test_shapes_are_shown_in_a_row():
    look = Look()
    look.show_shapes([vg.shapes.sphere(), vg.shapes.box()])
    assert len(look.stage.renderer.actors) == 2
    look.stage.close()


def test_contacts_and_force_chains_stand_in_place_of_grains(look, bed):
    assert look.ways() == [GRAINS, CONTACTS, CHAINS]
    drawn = {}
    for way in look.ways():
        look.show(bed, way=way)
        drawn[way] = shot(look.stage)
        assert any("grain" in mesh.cell_data for mesh in meshes(look)) == (way == GRAINS)
    assert all((one != other).any() for one, other in itertools.combinations(drawn.values(), 2))
    bare = dataclasses.replace(bed, forces=None)
    look.show(bare)
    assert look.ways() == [GRAINS, CONTACTS]


def test_a_picked_grain_is_marked_and_drawn_alone_where_it_lies(look, bed):
    grain = int(np.flatnonzero(bed.shape_id == 0)[-1])
    before = list(look.stage.camera_position)
    look.picked = grain
    assert look.ways()[3:] == [ALONE + name for name in ("surface", "voxels", "points", "clump", "neighbours")]
    look.show(bed)
    marked = meshes(look)[1]
    assert marked.center == pytest.approx(bed.position[grain], abs=0.05)
    for way in look.ways()[3:]:
        look.show(bed, way=way, alone=look.alone(way))
        low, high = np.reshape(look.stage.bounds, (3, 2)).T
        assert ((low < bed.position[grain]) & (bed.position[grain] < high)).all()
        assert (high - low).max() < (3.5 if "neighbours" in way else 2.2) * bed.diameters[grain]
    look.show(bed)
    assert [tuple(one) for one in look.stage.camera_position] == [tuple(one) for one in before]
    # another packing has no picked grain
    look.show(bed[:5])
    assert look.picked is None


def test_the_scale_bar_follows_the_camera(look):
    def bar():
        return [actor.GetInput() for actor in look.stage.actors.values() if hasattr(actor, "GetInput")]

    shot(look.stage)
    wide, count = bar(), len(look.stage.actors)
    look.stage.camera.zoom(10)
    shot(look.stage)
    assert wide[0].endswith(" mm")
    assert float(bar()[0].split()[0]) < float(wide[0].split()[0])
    assert len(look.stage.actors) == count


def test_a_narrow_window_shows_the_whole_container_and_one_that_is_turned_stays_in_sight():
    look = Look()
    look.show(vg.Packing.of(vg.shapes.sphere(), vg.Box((9, 9, 3)), position=[(5, 5, 1.5)]))
    wide = look.stage.camera.parallel_scale
    look.stage.window_size = (450, 700)
    look.fit(2.0)
    assert look.stage.camera.parallel_scale == pytest.approx(2 * wide)
    look.stage.window_size = (900, 700)
    look.fit(0.5)
    assert look.stage.camera.parallel_scale == pytest.approx(wide)
    # one that is high has room at its sides
    look.show(vg.Packing.of(vg.shapes.sphere(), vg.Box((3, 3, 9)), position=[(1.5, 1.5, 1.5)]))
    high = look.stage.camera.parallel_scale
    look.stage.window_size = (800, 700)
    look.fit(9 / 8)
    assert look.stage.camera.parallel_scale == pytest.approx(high)
    look.stage.camera.Azimuth(20)
    look.fit(1.5)
    assert look.stage.camera.parallel_scale == pytest.approx(1.5 * high)
    look.stage.close()


def test_grains_that_are_cut_are_full():
    """What is seen at the plane has one shade, where the inside of a shell has many."""
    look = Look()
    look.show(vg.Packing.of(vg.shapes.sphere(diameter=4), vg.Box((4, 4, 4)), position=[(2, 2, 2)]))
    look.cut((1, 1, 0.5))
    shades, many = np.unique(shot(look.stage).reshape(-1, 3), axis=0, return_counts=True)
    green = many[shades[:, 1] > 1.3 * shades[:, 0]]
    assert green.max() > 0.4 * green.sum()
