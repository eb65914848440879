"""What does not fit in memory is refused before anything is made, by `pack` as by the plan; coarse voxels are told."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, TooLargeError

SPHERE, BOX = vg.make_shape("sphere"), vg.Box((4, 4, 4))


@pytest.mark.parametrize("method", vg.packing_methods())
def test_every_method_is_refused_where_memory_is_short(method, monkeypatch):
    monkeypatch.setattr("voxgran.packing.method.memory_limit", lambda: 2**20)
    monkeypatch.setattr("voxgran.packing.pack.drive", lambda *_: pytest.fail("something was packed"))
    with pytest.raises(TooLargeError, match=r"the packing needs about 0\.. GiB: this machine has 0\.0 GiB; make "):
        vg.pack(SPHERE, BOX, method=method, count=3)


@pytest.mark.filterwarnings("ignore:all 10 grains")
@pytest.mark.parametrize("method", ["digital", "digital_fill", "digital_rsa"])
def test_a_lattice_beyond_the_memory_is_refused_in_a_sentence(method, monkeypatch):
    monkeypatch.setattr("voxgran.packing.method.memory_limit", lambda: 2**33)
    words = r"needs about \d+\.\d GiB: this machine has 8\.0 GiB; make the voxels larger or the grains fewer"
    with pytest.raises(TooLargeError, match=words):
        vg.pack(SPHERE, vg.Box((1000, 1000, 1000)), method=method, count=10, voxel_size=0.1)


def test_plan_and_pack_refuse_alike(monkeypatch):
    asked = {"method": "digital_fill", "count": 9, "voxel_size": 0.05}
    scene = vg.Scene.from_mapping(
        {
            "shape": [{"family": "sphere"}],
            "container": {"kind": "box", "lengths": [30, 30, 30]},
            "packing": asked,
            "output": {"report": False},
        }
    )
    needed = scene.plan().memory
    monkeypatch.setattr("voxgran.packing.pack.drive", lambda *_: pytest.fail("it began"))
    for limit, error in ((needed - 1, TooLargeError), (needed, pytest.fail.Exception)):
        monkeypatch.setattr("voxgran.packing.method.memory_limit", lambda limit=limit: limit)
        with pytest.raises(error, match=r"the packing needs about|it began"):
            vg.pack(SPHERE, vg.Box((30, 30, 30)), **asked)
    assert scene.plan().memory == needed
    monkeypatch.setattr("voxgran.packing.method.memory_limit", lambda: needed - 1)
    with pytest.raises(TooLargeError, match="the scene needs about"):
        scene.plan()


@pytest.mark.parametrize("method", ["digital", "digital_fill", "digital_rsa"])
def test_coarse_voxels_are_to_be_made_finer_and_not_the_container_larger(method):
    with pytest.warns(PackingWarning, match=r"of 10 grains .* voxel_size is 2; make it at most 0\.1$"):
        vg.pack(SPHERE, BOX, method=method, count=10, voxel_size=2.0)
    with pytest.raises(InputError, match="voxel_size is 5: the container is only 4 wide; make the voxels smaller"):
        vg.pack(SPHERE, BOX, method=method, count=10, voxel_size=5.0)
    with pytest.raises(InputError, match="voxel_size is 5: the container is only 4 wide"):
        vg.pack(SPHERE, vg.Box((9, 4, 4), "y"), method=method, count=10, voxel_size=5.0)
    with pytest.warns(PackingWarning, match="make the container larger|no grain finds room"):
        vg.pack(SPHERE, vg.Box((2, 2, 2)), method=method, count=9, voxel_size=0.1)


def test_the_unit_of_lengths_does_not_matter_to_what_is_coarse():
    with pytest.warns(PackingWarning, match=r"voxel_size is 0\.002; make it at most 0\.0001$"):
        vg.pack(
            SPHERE.scaled(1e-3), vg.Box((4e-3,) * 3), method="digital_fill", count=10, voxel_size=2e-3, order="largest"
        )


def test_an_image_or_voxels_coarser_than_what_they_show_are_refused():
    packing = vg.Packing.of([SPHERE], BOX, position=[(2, 2, 2)])
    assert vg.to_image(packing, 4.0).shape == (1, 1, 1)
    for size in (4.1, 100.0):
        with pytest.raises(InputError, match=rf"voxel_size is {size:g}: the container is only 4 wide; make the voxels"):
            vg.to_image(packing, size)
    flat = vg.Packing.of([vg.make_shape("disk")], vg.Rectangle((4, 2)), position=[(1, 1, 0)])
    assert vg.to_image(flat, 2.0).shape == (2, 1, 1)
    with pytest.raises(InputError, match="only 2 wide"):
        vg.to_image(flat, 2.5)
    # the shares of a solid are exact at any voxel size
    rod = vg.make_shape("box", lengths=(4.0, 0.1, 0.1))
    assert vg.voxelize(rod, voxel_size=40.0, fraction=True).fraction.sum() * 40.0**3 == pytest.approx(rod.volume)


def test_a_packing_takes_its_own_arrays_and_little_beside_them():
    """Its checks copied all arrays, and the squares of the quaternions twice: 50 bytes a grain of a million."""
    given = {"position": np.full((200_000, 3), 2.0), "orientation": np.tile([1.0, 0, 0, 0], (200_000, 1))}
    tracemalloc.start()
    try:
        made = vg.Packing.of(SPHERE, vg.Box((4, 4, 4)), **given)
        most = [tracemalloc.get_traced_memory()[1]]
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        assert dataclasses.replace(made, stop_reason="count").position is made.position
        most.append(tracemalloc.get_traced_memory()[1] - before)
    finally:
        tracemalloc.stop()
    # of which 72 bytes are the packing
    assert most[0] < 120 * made.count
    assert most[1] < 45 * made.count
    assert not any(np.shares_memory(array, getattr(made, name)) for name, array in given.items())
