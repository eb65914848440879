"""How errors that are stated shrink."""

import math

import numpy as np
import pytest

from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.measures import region, window
from voxgran.measures.region import Regions
from voxgran.measures.window import Solids
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")


def test_cut_cylinders_converge_with_the_square_of_the_sides(monkeypatch):
    shape = Shape.of(Primitive("cylinder", (0.5, 1.0)), name="cylinder")
    packing = Packing.of([shape], Box((4, 4, 4)), position=[[2, 2, 2]])
    # a segment beyond 0.23 of the radius, whose ends are no corners of the prisms
    angle = math.acos(0.23)
    exact = 0.25 * (angle - 0.23 * math.sin(angle))
    errors = []
    for sides in (45, 90, 180, 360):
        monkeypatch.setattr(window, "FINE", sides)
        found = Solids(packing).volume(np.array([2 + 0.115, 0, 0]), np.full(3, 4.0))
        assert abs(found - exact) <= found.error
        errors.append(found.error)
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates == pytest.approx([2.0] * 3, abs=0.02)


def test_the_quadrature_of_spheres_in_cylinders_converges_fast():
    centers, radii = np.array([[0.9, 0.0, 0.0], [0.3, 0.4, 0.1]]), np.array([0.5, 0.7])
    found = {}
    for points in (5, 10, 20, 40, 80):
        ends = np.array([[-1.0, -1.0], [1.0, 1.0]])
        apart = np.hypot(centers[:, 0], centers[:, 1])
        found[points] = region._quadrature(apart / radii, 1 / radii, ends, points)
    errors = [np.abs(found[n] - found[80]).max() for n in (5, 10, 20, 40)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-9
    assert errors[3] < 1e-13


def test_samples_converge_with_the_square_root_of_their_number(monkeypatch):
    position = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2, np.arange(8) + 0.5, indexing="ij"), axis=-1).reshape(-1, 3)
    position = position[np.hypot(position[:, 0], position[:, 1]) <= 3.5]
    container = Cylinder(4, 8)
    packing = Packing.of([BALL], container, position=position, gravity=None)
    exact = Regions(packing).at(1.3)
    wanted = exact.solid(Solids(packing))
    assert wanted.error < 1e-9
    stated = []
    for points in (4000, 16000, 64000):
        monkeypatch.setattr(region, "POINTS", points)
        monkeypatch.setattr(region, "CONTAINER_POINTS", points)
        regions = Regions(packing)
        sampled = region.SampledRegion(regions.samples, 1.3, regions.limits)
        found, room = sampled.solid(regions.solids), sampled.volume
        assert abs(found - wanted) < 4 * found.error
        assert abs(room - exact.volume) < 4 * room.error
        stated.append((found.error, room.error))
    rates = np.log2(np.array(stated[:-1]) / np.array(stated[1:])) / 2
    assert rates == pytest.approx(np.full((2, 2), 0.5), abs=0.1)
