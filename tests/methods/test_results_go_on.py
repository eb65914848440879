"""The packing of every method comes to rest, and is a start for another method."""

import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import PackingWarning
from voxgran.packing.method import method_registry

#: methods for which a box will not do, with another container
CONTAINERS = {"apollonian": vg.Sphere(2.5)}
#: what makes a method quick
QUICK = {"digital": {"voxel_size": 0.1}, "digital_fill": {"voxel_size": 0.1}, "digital_rsa": {"voxel_size": 0.1}}


@pytest.fixture(scope="module")
def packed():
    """Return a function that packs thirty spheres by a method, once."""
    kept = {}

    def make(method):
        if method not in kept:
            container = CONTAINERS.get(method, vg.Box((4, 4, 5), periodic="x"))
            sizes = None if method_registry().get(method).sizing == "made" else vg.sizes.uniform(0.7, 1.0)
            with warnings.catch_warnings(action="ignore", category=PackingWarning):
                sphere = vg.make_shape("sphere")
                kept[method] = vg.pack(sphere, container, method, count=30, sizes=sizes, **QUICK.get(method, {}))
        return kept[method]

    return make


@pytest.mark.parametrize("method", [slow(name) if name == "multilayer" else name for name in vg.packing_methods()])
def test_it_comes_to_rest(method, packed):
    bed = vg.settle(packed(method), gravity="-z")
    assert bed.count == packed(method).count
    assert vg.verify(bed).ok
    assert bed.position[:, 2].mean() <= packed(method).position[:, 2].mean() + 0.05


@pytest.mark.parametrize("method", vg.packing_methods())
def test_it_is_a_start(method, packed):
    first = packed(method)
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        more = vg.pack(vg.make_shape("sphere", diameter=0.3), first.container, "rsa", start=first, count=5)
    assert more.count > first.count
    assert more.position[: first.count] == pytest.approx(first.position, abs=1e-12)
    assert np.allclose(more.diameter[: first.count], first.diameter, rtol=1e-12)
    assert vg.verify(more).ok
