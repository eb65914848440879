"""What all clump methods have in common."""

import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import PackingWarning

METHODS = vg.clump_methods()
COUNT = 12


@pytest.fixture(scope="module")
def cube():
    return vg.make_shape("box", lengths=(1, 1, 1))


@pytest.fixture(scope="module")
def solids(eros, cube):
    return {"eros": eros, "cube": cube}


@pytest.fixture(scope="module")
def clumps(solids):
    """Return the clump of each method and solid, made once."""
    made = {}

    def clump(method, name):
        if (method, name) not in made:
            made[method, name] = fitted(solids[name], method)
        return made[method, name]

    return clump


def fitted(shape, method, **options):
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        return vg.fit_clump(shape, method=method, **{"max_spheres": COUNT} | options)


@pytest.mark.parametrize("name", ["eros", slow("cube")])
@pytest.mark.parametrize("method", METHODS)
def test_the_number_asked_is_returned_with_all_centers_inside(clumps, solids, method, name):
    clump, shape = clumps(method, name), solids[name]
    assert clump.method == method
    assert clump.count == COUNT if not clump.reason else clump.count < COUNT
    assert (shape.signed_distance(clump.centers) < 0).all()
    assert (clump.radii > 0.01 * shape.diameter).all()
    assert clump.errors.iou > 0.55
    # no sphere within another
    apart = np.linalg.norm(clump.centers[:, None] - clump.centers, axis=2) + clump.radii
    np.fill_diagonal(apart, np.inf)
    assert (apart > clump.radii[:, None] * (1 - 1e-9)).all()


@pytest.mark.parametrize("name", ["eros", slow("cube")])
@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_bits(clumps, solids, method, name):
    clump, again = clumps(method, name), fitted(solids[name], method)
    assert np.array_equal(clump.centers, again.centers)
    assert np.array_equal(clump.radii, again.radii)
    assert clump.errors == again.errors


@pytest.mark.parametrize("method", METHODS)
def test_the_clump_scales_with_the_solid(clumps, eros, method):
    clump, small = clumps(method, "eros"), fitted(eros.scaled(2.0**-10), method)
    assert np.allclose(small.centers * 2.0**10, clump.centers, rtol=0, atol=1e-9 * eros.diameter)
    assert np.allclose(small.radii * 2.0**10, clump.radii, rtol=1e-9, atol=0)
    assert small.errors.iou == pytest.approx(clump.errors.iou, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_voxels_give_nearly_the_clump_of_the_mesh(clumps, eros, method):
    clump = fitted(vg.voxelize(eros, voxel_size=eros.diameter / 40), method)
    assert (clump.shape.signed_distance(clump.centers) < 0).all()
    assert clump.errors.iou == pytest.approx(clumps(method, "eros").errors.iou, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_more_spheres_lower_the_error(clumps, eros, method):
    assert fitted(eros, method, max_spheres=60).errors.iou > clumps(method, "eros").errors.iou + 0.03


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_one_sphere_stands_for_a_tessellated_sphere(method):
    shape = vg.make_shape("sphere")
    mesh = vg.Shape.from_mesh(shape.vertices, shape.faces, name="tessellated")
    clump = fitted(mesh, method, max_spheres=1)
    assert clump.count == 1
    assert clump.errors.iou > 0.97
    assert clump.errors.centroid < 0.01
