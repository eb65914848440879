"""Warnings point at the line of the user, however deep in voxgran they are issued."""

import warnings

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import PackingWarning


def labels():
    """Return an image of a bed of two grains that leaves its upper half empty."""
    image = np.zeros((16, 16, 30), dtype=int)
    image[1:15, 1:8, 1:12], image[1:15, 8:15, 1:12] = 1, 2
    return image


def few():
    return vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])


@pytest.mark.parametrize(
    "call",
    [
        lambda: vg.packing_of_labels(labels(), voxel_size=0.1),
        lambda: vg.measure(few(), "density"),
        lambda: few().measure("density"),
        lambda: vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=500),
    ],
    ids=["labels", "measure", "method", "pack"],
)
def test_a_warning_points_at_the_line_of_the_user(call):
    with warnings.catch_warnings(record=True, action="always") as caught:
        call()
    assert caught
    assert all(issubclass(one.category, PackingWarning) and one.filename == __file__ for one in caught)
