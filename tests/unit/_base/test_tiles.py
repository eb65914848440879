"""Tiles against plain products."""

import numpy as np
import pytest

from voxgran._base.arithmetic.tiles import COLUMNS, ROWS, add_tile, padded
from voxgran._base.kernels import kernel
from voxgran._base.seeds import stream


@kernel
def _added(out, a, strip, row, column, begin, terms):
    add_tile(out, a, strip, row, column, begin, terms)


@pytest.mark.parametrize("terms", [0, 1, 9])
def test_a_tile_is_a_product_of_rows_and_of_a_strip(terms):
    draw = stream(1, "tiles")
    out, a, strip = draw.normal(size=(8, 30)), draw.normal(size=(8, 10)), draw.normal(size=(20, COLUMNS))
    expected = out.copy()
    expected[4 : 4 + ROWS, 13 : 13 + COLUMNS] += a[4 : 4 + ROWS, :terms] @ strip[7 : 7 + terms]
    _added(out, a, strip, 4, 13, 7, terms)
    assert out == pytest.approx(expected, abs=1e-14)


def test_products_are_added_with_one_rounding():
    out, a, strip = np.zeros((ROWS, COLUMNS)), np.zeros((ROWS, 2)), np.zeros((2, COLUMNS))
    # the square is 1 + 2^-29 + 2^-60, whose last digit a product alone would lose
    a[:, 0], strip[0] = 1.0, -1.0 - 2.0**-29
    a[:, 1], strip[1] = 1.0 + 2.0**-30, 1.0 + 2.0**-30
    _added(out, a, strip, 0, 0, 0, 2)
    assert (out == 2.0**-60).all()


def test_padding():
    assert [padded(count, 4) for count in (0, 1, 4, 5)] == [0, 4, 4, 8]
