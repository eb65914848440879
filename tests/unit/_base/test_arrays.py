"""The door: what is good passes unchanged, what is bad is named."""

import numpy as np
import pytest

from voxgran._base.arrays import as_count, as_faces, as_floats, as_number, as_points, as_quaternions
from voxgran._base.errors import InputError, VoxgranError


def test_good_points_pass_as_float64():
    points = as_points([[1, 2, 3], [4, 5, 6]])
    assert points.dtype == np.float64
    assert points.flags.c_contiguous
    assert points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([[1, 2]], r"shape \(1, 2\).*\(n, 3\)"),
        ([[1, 2, np.nan]], r"nan at index \(0, 2\)"),
        ([["a", "b", "c"]], "must be an array of numbers of shape"),
        ([[np.inf, 0, 0]], "inf at index"),
    ],
)
def test_bad_points_are_named(value, words):
    with pytest.raises(InputError, match=words):
        as_points(value)


def test_errors_are_what_people_catch():
    with pytest.raises(ValueError, match="shape"):
        as_floats([1.0], "sizes", shape=(2,))
    assert issubclass(InputError, VoxgranError)


@pytest.mark.parametrize("faces", [[[0, 1, 3]], [[-1, 0, 1]], [[0.0, 1.0, 2.0]], [[0, 1, 2, 0]]])
def test_bad_faces_are_refused(faces):
    with pytest.raises(InputError, match="faces"):
        as_faces(faces, 3)


def test_quaternions_keep_their_bits_when_they_are_unit():
    q = np.array([[1.0, 0, 0, 0], [0.5, 0.5, 0.5, 0.5]])
    assert np.array_equal(as_quaternions(q), q)
    with pytest.raises(InputError, match="length"):
        as_quaternions([[1.0, 1.0, 0, 0]])


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, "1", True])
def test_bad_numbers_are_refused(value):
    with pytest.raises(InputError, match="radius"):
        as_number(value, "radius", above=0.0)


@pytest.mark.parametrize("value", [-1, 1.5, True, None])
def test_bad_counts_are_refused(value):
    with pytest.raises(InputError, match="count"):
        as_count(value, "count")
