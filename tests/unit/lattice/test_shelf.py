"""Arrays on a shelf are those that were put there, and stay in memory where the disk is full."""

import tempfile

import numpy as np
import pytest

import voxgran as vg
from voxgran.lattice import image as lattice_image

pytest.importorskip("dask.array")


def test_arrays_come_back_from_files_of_several_sizes(monkeypatch):
    monkeypatch.setattr(lattice_image, "SHARED", 100)
    shelf = lattice_image.Shelf()
    given = [np.arange(n, dtype=kind).reshape(-1, 3) for n, kind in ((0, "i4"), (9, "u2"), (33, "u1"), (90, "f8"))]
    found = [shelf.put(array) for array in given]
    for one, other in zip(given, found, strict=True):
        assert np.array_equal(one, other)
        assert one.dtype == other.dtype
        assert other.ctypes.data % one.itemsize == 0
    assert len({id(array.base) for array in found[1:]}) == 2


def test_arrays_stay_in_memory_where_the_disk_is_full(monkeypatch):
    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    array = np.arange(6)
    assert lattice_image.Shelf().put(array) is array


def test_surfaces_of_an_image_in_blocks_lie_in_files():
    image = np.zeros((12, 10, 10), dtype=np.uint8)
    image[1:5, 1:6, 1:6], image[6:11, 2:8, 3:9] = 1, 2
    lazy = vg.open_image(image, block=6)
    whole, grouped = (vg.packing_of_labels(each, voxel_size=1.0, gravity="none") for each in (image, lazy))
    assert [shape.key for shape in whole.shapes] == [shape.key for shape in grouped.shapes]
    for one, other in zip(whole.shapes, grouped.shapes, strict=True):
        assert one.geometry.corners.base is None or one.geometry.corners.base.__class__ is np.ndarray
        assert type(other.geometry.corners.base).__name__ == "mmap"
        assert type(other.geometry.points.steps.base).__name__ == "mmap"
