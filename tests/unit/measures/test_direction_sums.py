"""Sums over directions are those of plain NumPy."""

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.measures.directions import (
    BLOCK,
    ON_EQUATOR,
    RINGS,
    mean_products,
    multisets,
    shares_of_map,
    unit_vectors,
    values_along,
    wave_products,
    wave_signs,
)

COUNT = 3 * BLOCK + 7


@pytest.fixture(params=[2, 3])
def sample(request):
    """Return directions (m, d), shares (m,) and places (m, d)."""
    draw = stream(4, "directions", request.param)
    way = draw.normal(size=(COUNT, request.param))
    share = draw.random(COUNT)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return way, share / share.sum(), draw.random(way.shape)


def products(way):
    """Return the products of four components, (m, k)."""
    return np.array([way[:, list(some)].prod(axis=1) for some in multisets(way.shape[1])]).T


def test_sums_of_products_and_of_their_waves(sample):
    way, share, turns = sample
    assert mean_products(way, share) == pytest.approx(share @ products(way), abs=1e-15)
    signs = wave_signs(way.shape[1])
    assert len(np.unique(np.concatenate([signs, -signs]), axis=0)) == 2 * len(signs) == 3 ** way.shape[1] - 1
    phase = 2.0 * np.pi * signs @ turns.T
    plain = (np.concatenate([np.cos(phase), np.sin(phase)]) * share) @ products(way)
    assert wave_products(way, share, turns) == pytest.approx(plain, abs=1e-15)


def test_values_of_tensors_along_directions(sample):
    way, _, _ = sample
    d = way.shape[1]
    draw = stream(5, "tensors", d)
    second, fourth = draw.normal(size=(d, d)), draw.normal(size=len(multisets(d)))
    one, two = values_along(way, second + second.T, fourth)
    assert one == pytest.approx(np.einsum("mi,ij,mj->m", way, second + second.T, way), abs=1e-14)
    assert two == pytest.approx(products(way) @ fourth, abs=1e-14)


def test_unit_vectors_leave_out_zero_and_keep_the_digits_of_any_length(sample):
    way, _, _ = sample
    long = way * np.logspace(-300, 300, COUNT)[:, None]
    long[::5] = 0.0
    unit, kept = unit_vectors(long)
    assert (kept == (np.arange(COUNT) % 5 > 0)).all()
    assert unit == pytest.approx(way[kept], abs=1e-15)


@pytest.mark.parametrize("pole", [0, 1, 2])
def test_shares_of_an_equal_area_map(pole):
    draw = stream(6, "map", pole)
    way, weight = draw.normal(size=(COUNT, 3)), draw.random(COUNT)
    way[::7, pole] = 0.0
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    turned = np.roll(way, 2 - pole, axis=1)
    both, owner = np.concatenate([turned, -turned]), np.tile(np.arange(COUNT), 2)
    on = both[:, 2] >= -ON_EQUATOR
    (x, y, z), owner = both[on].T, owner[on]
    ring = np.minimum(((np.sqrt(1.0 - np.maximum(z, 0.0)) * 9 + 1.0) / 2.0).astype(int), RINGS)
    place = np.floor(np.arctan2(y, x) / (2.0 * np.pi) * np.maximum(8 * ring, 1) + 0.5) % np.maximum(8 * ring, 1)
    cell = np.where(ring > 0, (2 * ring - 1) ** 2 + place, 0).astype(int)
    part = weight[owner] / np.bincount(owner)[owner]
    for found, plain in zip(shares_of_map(way, weight, pole), (part, part**2), strict=True):
        assert found == pytest.approx(np.bincount(cell, plain, minlength=81), rel=1e-12)
