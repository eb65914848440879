"""Beds with a known end: inclines, stacks, pyramids, dominoes, lids, and beds that are the same from another view."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from kit import lattice, mesh_box

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.settling.parameters import Settling
from voxgran.settling.stages import FALL, Settler
from voxgran.packing.settle import normalized_assembly

SPHERE = vg.make_shape("sphere")
CUBE = vg.make_shape("box", lengths=(1.0, 1.0, 1.0))
#: distance at which surfaces rest
KEPT = 5e-4


def packed(shapes, container, position, **more):
    """Return grains at these places."""
    return vg.Packing.of(shapes, container, position=np.asarray(position, dtype=float), **more)


def loose(count, *, lengths=(5, 5, 12), periodic="xy", seed=3, shapes=SPHERE, **more):
    """Return grains in the air, apart from each other."""
    return vg.pack(shapes, vg.Box(lengths, periodic=periodic), method="rsa", count=count, seed=seed, **more)


def incline(angle, *, shape=CUBE):
    """Return a grain on the floor of a box, under gravity that is oblique to it."""
    down = (np.sin(angle), 0.0, -np.cos(angle))
    return packed(shape, vg.Box((40, 6, 6)), [[4, 3, 0.5 + KEPT]], gravity=down)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_cube_on_an_incline_rests_up_to_the_angle_of_friction(friction):
    """The residual above it is the force that friction cannot hold."""
    for part in (1 - 1e-3, 1 + 1e-3):
        angle = np.arctan(part * friction)
        found = vg.equilibrium(incline(angle), friction=friction, tolerance=1e-4)
        slip = max(np.sin(angle) - friction * np.cos(angle), 0.0)
        # the residual of the best forces: they may lie along the edge of the cone
        assert bool(found.rests.all()) == (part < 1)
        assert float(found.residual[0]) == pytest.approx(slip * np.cos(np.arctan(friction)), abs=2e-5)


def test_a_cube_slides_to_the_wall_or_stays():
    stays, slides = (
        vg.settle(incline(np.arctan(part * 0.4)), friction=0.4, fall_time=30.0) for part in (0.98, 1.2)
    )
    assert stays.position[0, 0] == pytest.approx(4.0, abs=1e-2)
    assert slides.position[0, 0] == pytest.approx(39.5, abs=1e-2)
    assert stays.stop_reason == slides.stop_reason == "settled"


def falling(packing, time, **options):
    """Let a packing fall with inertia for a time, though it may rest, and return it after all stages."""
    how = Settling(fall_time=time, **options)
    assembly, unit = normalized_assembly(packing)
    settler = Settler(assembly, how, np.array(packing.gravity, dtype=float))
    settler.progress.stage = FALL
    # a fall of this length, whether the grains sink or not
    while settler.progress.stage == FALL and settler.progress.stage_step + 1 < time / 0.05:
        settler.progress.heights = np.zeros(0)
        settler.bed_moved = None if False else None
        settler.step()
    while not settler.ended:
        settler.step()
    position, orientation = settler.bed.poses()
    return replace(packing, position=position * unit, orientation=orientation), settler
