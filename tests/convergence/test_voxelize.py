"""How fast voxel volumes tend to the true volume: order 2 in random poses, order 1 for faces along the lattice."""

import numpy as np
import pytest
from kit import mesh_box

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.voxels.occupy import voxelize

RESOLUTIONS = np.array([8, 16, 32, 64])


def rms_errors(shape, turns, *, fraction=False):
    errors = []
    for resolution in RESOLUTIONS:
        found = [
            voxelize(shape.rotated(turn), voxel_size=shape.diameter / resolution, fraction=fraction).volume
            for turn in turns
        ]
        errors.append(np.sqrt(np.mean((np.array(found) / shape.volume - 1) ** 2)))
    return np.array(errors)


def order(errors):
    return -np.polyfit(np.log(RESOLUTIONS), np.log(errors), 1)[0]


def test_centers_converge_with_order_2_in_random_poses(data_dir):
    turns = random_rotations(stream(10, "poses"), 12)
    for shape in (mesh_box([1.0, 0.8, 0.6]), vg.load_shape(data_dir / "bennu_lp.obj")):
        assert 1.7 < order(rms_errors(shape, turns)) < 2.5


def test_centers_of_round_solids_in_closed_form_converge_with_order_2():
    turns = random_rotations(stream(10, "poses"), 12)
    shape = Shape.of(Primitive("ellipsoid", (1.0, 0.8, 0.7)), name="ellipsoid")
    assert 1.7 < order(rms_errors(shape, turns)) < 2.5


def test_faces_along_the_lattice_converge_with_order_1_only():
    # lengths in no simple ratio to the voxels: the first layer is counted whole or not at all
    errors = []
    for resolution in RESOLUTIONS:
        found = []
        for extra in np.linspace(0.05, 0.95, 10):
            length = 1 + extra / resolution
            box = mesh_box([length, 1.0, 1.0])
            found.append(voxelize(box, voxel_size=1 / resolution).volume / length - 1)
        errors.append(np.sqrt(np.mean(np.square(found))))
    assert 0.9 < order(np.array(errors)) < 1.1


@pytest.mark.parametrize("resolution", [8, 16, 32])
def test_touched_voxels_exceed_the_volume_by_half_a_layer_or_more(resolution):
    # Steiner: a cube meets the solid where the solid meets the cube about its middle
    box = mesh_box([1.0, 0.8, 0.6])
    size = box.diameter / resolution
    turn = random_rotations(stream(10, "poses"), 1)[0]
    excess = voxelize(box.rotated(turn), voxel_size=size, cover="touch").volume / box.volume - 1
    layer = box.surface_area * size / box.volume
    assert 0.5 * layer < excess < 1.2 * layer


def test_shares_are_exact_at_every_resolution(data_dir):
    shape = vg.load_shape(data_dir / "bennu_lp.obj")
    turns = random_rotations(stream(10, "poses"), 6)
    assert rms_errors(shape, turns, fraction=True).max() < 1e-13
