"""The door: what is good passes unchanged, what is bad is named."""

import numpy as np
import pytest

from voxgran._base.arrays import as_count, as_faces, as_flag, as_floats, as_number, as_points, as_quaternions, as_share
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


@pytest.mark.parametrize("value", [True, False, np.True_, np.array(False)])
def test_flags_pass_as_those_of_python(value):
    assert as_flag(value, "squared") is bool(value)


@pytest.mark.parametrize("value", ["no", "False", "0", 1.0, 1, 0, None, [], np.array([True])])
def test_what_is_no_flag_is_refused(value):
    with pytest.raises(InputError, match=r"^squared is .*: it must be True or False$"):
        as_flag(value, "squared")


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.1, 1.1, "1", True, None])
def test_what_is_no_share_is_refused(value):
    with pytest.raises(InputError, match="rest is "):
        as_share(value, "rest", zero=True)


def test_a_share_of_nothing_is_one_where_that_is_said():
    assert (as_share(0, "rest", zero=True), as_share(1, "rest")) == (0.0, 1.0)
    with pytest.raises(InputError, match="above 0"):
        as_share(0, "rest")
