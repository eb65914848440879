"""A packing with meshes and primitives, and what is measured of it."""

import numpy as np
import pytest
import xarray as xr
from kit import lattice

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.sizes import uniform
from voxgran.shapes.tessellate import unit_box

SHAPES = (
    Shape.of(Primitive("sphere", (0.5,)), name="sphere"),
    Shape.from_mesh(unit_box()[0] * [0.7, 0.8, 1.2], unit_box()[1], name="<block> & co"),
)


@pytest.fixture
def packing():
    """Return 48 grains of two shapes on a lattice, turned at random."""
    position = lattice(4, 4, 3)
    generator = stream(2, "report")
    turns = generator.normal(size=(48, 4))
    return Packing.of(
        SHAPES,
        Box((4, 4, 4)),
        position=position,
        orientation=turns / np.linalg.norm(turns, axis=1, keepdims=True),
        scale=0.6 + 0.3 * generator.random(48),
        shape_id=np.arange(48) % 2,
        unit="mm",
        provenance={
            "method": "digital",
            "parameters": {"voxel_size": 0.05, "gravity": "-z"},
            "seed": 12,
            "asked": {"count": 50, "sizes": {"kind": "uniform", "low": 0.5, "high": 0.9}},
            "missed": {"count": 2},
            "timing": {"wall_seconds": 1.5},
        },
        contact_gap=0.05,
        asked_sizes=uniform(0.5, 0.9),
    )


@pytest.fixture
def flat():
    """Return two disks and a triangle in two dimensions."""
    corners = np.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]])
    shapes = [
        Shape.of(Outline("disk", radius=0.5), name="disk"),
        Shape.of(Outline("polygon", vertices=corners), name="tri"),
    ]
    return Packing.of(shapes, Rectangle((4, 3)), position=[[1, 1, 0], [3, 1, 0], [2, 2, 0]], shape_id=[0, 0, 1])


@pytest.fixture
def statistics(packing):
    """Return a tree as the measures make it."""
    height = ("height", [0.5, 1.5, 2.5], {"units": "mm", "long_name": "height"})
    gap = ("gap", [0.0, 1e-3, 1e-2], {"units": "mean diameter", "long_name": "gap"})
    solid = xr.DataArray([0.3, 0.35, np.nan], dims="height", attrs={"long_name": "solid fraction at a height"})
    number = ("gap", [0.5, 2.0, 4.0], {"units": "1", "long_name": "mean coordination number"})
    return xr.DataTree.from_dict(
        {
            "/": xr.Dataset({"solid_fraction": packing.solid_fraction, "bulk_solid_fraction": 0.4321}),
            "/profiles": xr.Dataset(
                {"solid_fraction_height": solid, "solid_fraction_height_error": 0.1 * xr.zeros_like(solid)},
                coords={"height": height},
            ),
            "/coordination": xr.Dataset({"coordination_number": number}, coords={"gap": gap}),
        }
    )
