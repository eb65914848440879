"""`fit_clump`: numbers of spheres, targets, exact cases, voxels, and what is refused."""

import re
import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, UnknownNameError
from voxgran.clumps.fit import clump_methods, fit_clump
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import unit_box
from voxgran.voxels.model import Voxels
from voxgran.voxels.occupy import voxelize


@pytest.fixture(scope="module")
def fifty(eros):
    return fit_clump(eros)


def test_the_shortest_call_has_fifty_spheres_of_small_error(eros, fifty):
    assert fifty.count == 50
    assert fifty.shape is eros
    assert fifty.method == "optimal"
    assert fifty.reason == ""
    assert fifty.errors.iou >= 0.96
    assert abs(fifty.errors.volume) < 1e-3
    assert fifty.errors.inertia < 0.01
    assert fifty.errors.centroid < 1e-3
    assert fifty.errors.surface_max < 0.05


def test_another_seed_gives_other_bits(eros, fifty):
    other = fit_clump(eros, seed=1)
    assert not np.array_equal(other.radii, fifty.radii)
    assert other.errors.iou == pytest.approx(fifty.errors.iou, abs=0.004)


@pytest.mark.parametrize("method", clump_methods())
def test_a_sphere_is_one_sphere(method):
    sphere = vg.make_shape("sphere", diameter=3.0)
    for count in (1, 7):
        clump = fit_clump(sphere, method=method, max_spheres=count)
        assert clump.count == 1
        assert clump.radii[0] == pytest.approx(1.5, abs=1e-9)
        assert np.abs(clump.centers).max() < 1e-9
        assert clump.reason == ("" if count == 1 else "the shape is exactly one sphere")


def test_a_union_of_spheres_is_its_own_clump():
    union = Shape.of(Spheres(np.array([[0, 0, 0], [0.7, 0.1, 0]]), np.array([0.5, 0.4])), name="two")
    with warnings.catch_warnings(action="error"):
        clump = fit_clump(union, max_spheres=5)
    assert np.array_equal(clump.centers, union.geometry.centers)
    assert np.array_equal(clump.radii, union.geometry.radii)
    assert "exactly these spheres" in clump.reason
    assert clump.errors.iou == pytest.approx(1.0, abs=1e-12)
    assert fit_clump(union, max_spheres=1).errors.iou < 0.8


def test_fewer_spheres_than_asked_are_explained(eros):
    with pytest.warns(PackingWarning, match=r"'eros' has \d+ spheres: no further sphere of radius 0.3"):
        clump = fit_clump(eros, max_spheres=50, overlap=False, min_radius=0.3)
    assert 0 < clump.count < 50


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "value", "found"),
    [slow("iou", 0.9, "iou"), slow("surface", 0.08, "surface_max"), ("inertia", 0.05, "inertia")],
)
def test_a_target_is_reached_with_the_fewest_spheres(eros, target, value, found):
    def reached(clump):
        error = getattr(clump.errors, found)
        return error >= value if target == "iou" else error <= value

    clump = fit_clump(eros, target=target, value=value)
    assert reached(clump)
    assert clump.count == 1 or not reached(fit_clump(eros, max_spheres=clump.count - 1))


@pytest.mark.slow
def test_the_target_of_a_biased_method_is_its_volume(eros):
    clump = fit_clump(eros, method="inscribed", target="volume", value=0.12)
    assert -0.12 <= clump.errors.volume < 0.0


@pytest.mark.slow
def test_a_target_of_the_volume_is_measured_before_volumes_are_matched(eros):
    # matched, one sphere has the volume of any solid
    clump = fit_clump(eros, target="volume", value=0.05)
    assert re.fullmatch(r"volume within 0\.0[0-4]\d* before it was matched, .* of 0\.\d+", clump.reason)
    free = [fit_clump(eros, max_spheres=count, match_volume=False).errors.volume for count in (1, 2)]
    assert abs(free[0]) > 0.05 > abs(free[1])
    assert clump.count == 2
    assert abs(clump.errors.volume) < 1e-5
    with pytest.raises(InputError, match=r"volume of at most 0\.05 .* up to 1 spheres; the best is 0\.2\d+, with 1"):
        fit_clump(eros, target="volume", value=0.05, max_spheres=1)


def test_an_unreachable_target_says_what_was_reached(eros):
    with pytest.raises(InputError, match=r"iou of at least 0.99 .* up to 4 spheres; the best is 0\.8.*, with 4"):
        fit_clump(eros, target="iou", value=0.99, max_spheres=4)


@pytest.mark.slow
@pytest.mark.parametrize(("resolution", "loss"), [(32, 0.015), slow(64, 0.005)])
def test_voxels_give_nearly_the_clump_of_the_mesh(eros, fifty, resolution, loss):
    voxels = voxelize(eros, voxel_size=eros.diameter / resolution)
    clump = fit_clump(voxels)
    assert clump.count == 50
    assert clump.shape.volume == pytest.approx(voxels.volume, rel=0.01)
    # judged against the mesh, in the frame of the voxels
    from voxgran.clumps.errors import clump_errors
    from voxgran.clumps.method import Body

    centers = (clump.centers + np.array(clump.shape.offset)) / eros.diameter
    errors = clump_errors(Body(eros), Spheres(centers, clump.radii / eros.diameter))
    assert errors.iou > fifty.errors.iou - loss


@pytest.mark.slow
def test_a_cavity_stays_a_cavity():
    vertices, faces, _ = unit_box()
    both = np.concatenate([vertices * 2, vertices])
    shell = Shape.of(Mesh(both, np.concatenate([faces, faces[:, ::-1] + 8])), name="shell")
    for solid in (shell, voxelize(shell, voxel_size=0.125)):
        clump = fit_clump(solid, max_spheres=40)
        assert clump.shape.volume == pytest.approx(7.0, rel=0.02)
        assert (np.abs(clump.centers).max(axis=1) > 0.5).all()


def test_bad_input_is_refused(eros):
    assert clump_methods() == ("cluster", "dynamic", "four_point", "inner_normal", "inscribed", "optimal")
    with pytest.raises(UnknownNameError, match="did you mean 'optimal'"):
        fit_clump(eros, method="optimul")
    with pytest.raises(UnknownNameError, match="min_radius"):
        fit_clump(eros, min_radios=1)
    for wrong, text in (
        ({"max_spheres": 0}, "max_spheres is 0: it must be a whole number, at least 1"),
        ({"target": "iou"}, "target is given without value: give both"),
        ({"value": 0.9}, "value is given without target"),
        ({"target": "iou", "value": 1.5}, "value is 1.5"),
        ({"target": "mass", "value": 0.5}, "target is 'mass'"),
        ({"seed": -1}, "seed is -1"),
        ({"mode": "best"}, "mode is 'best'"),
        ({"min_radius": -1.0}, "min_radius is -1"),
        ({"min_radius": 0.2, "max_radius": 0.1}, "max_radius is 0.1: it must be above min_radius, 0.2"),
        ({"mode": "bounding", "overlap": False}, "spheres without overlap leave gaps"),
        ({"min_radius": 5.0}, "no sphere of that radius fits in 'eros'; the largest has 0.3"),
    ):
        with pytest.raises(InputError, match=text):
            fit_clump(eros, **wrong)
    with pytest.raises(InputError, match="flat"):
        fit_clump(vg.make_shape("disk"))
    mask = np.zeros((9, 5, 5), dtype=bool)
    mask[1:3, 1:4, 1:4] = mask[5:8, 1:4, 1:4] = True
    with pytest.raises(InputError, match="2 separate bodies"):
        fit_clump(Voxels(mask, np.zeros(3), 1.0))
    with pytest.raises(InputError, match="solid"):
        fit_clump(Voxels(np.zeros((4, 4, 4), dtype=bool), np.zeros(3), 1.0))


def test_a_plate_too_thin_for_the_voxels_names_those_that_would_do():
    plate = vg.make_shape("box", lengths=(1.0, 1.0, 0.01))
    with pytest.raises(InputError, match=r"too thin for 64 voxels .* give a resolution of about (\d+)"):
        fit_clump(plate, method="inscribed", max_spheres=5)
    assert fit_clump(plate, max_spheres=5, min_radius=0.005).count == 5


def thin_shell(inner):
    """Return an ellipsoid with a cavity of its own form."""
    outer = vg.make_shape("ellipsoid", aspect=(1, 1, 1.0001))
    points, faces = outer.vertices, outer.faces
    both = np.concatenate([points, inner * points]), np.concatenate([faces, faces[:, ::-1] + len(points)])
    return Shape.of(Mesh(*both), name="shell")


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"uniform": True}, "too thin: no voxel of 0.05 equivalent diameters lies inside"),
        ({"overlap": False}, "too thin: no voxel of 0.025 equivalent diameters lies inside"),
        ({"method": "four_point"}, "no sphere fits"),
    ],
)
def test_thin_solids_are_refused_where_nothing_fits(parameters, text):
    with pytest.raises(InputError, match=text):
        fit_clump(vg.make_shape("box", aspect=(100, 100, 1)), **parameters)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize(
    "shape", [vg.make_shape("box", aspect=(100, 100, 1)), slow(thin_shell(0.97))], ids=["plate", "shell"]
)
def test_centers_stay_inside_thin_solids(shape):
    clump = fit_clump(shape)
    assert (shape.signed_distance(clump.centers) < 0).all()
    with pytest.raises(InputError, match="no sphere fits"):
        fit_clump(shape, overlap=False, uniform=True, min_radius=0.1, max_spheres=5)


@pytest.mark.slow
def test_a_long_rod_is_judged_on_a_coarser_lattice():
    errors = fit_clump(vg.make_shape("box", aspect=(1, 1, 300)), max_spheres=5).errors
    assert 0.0 < errors.iou < 0.5
    assert errors.iou_uncertainty < 0.05


@pytest.mark.slow
def test_the_volume_is_met_within_limits_of_the_radii():
    cube = vg.make_shape("box")
    assert abs(fit_clump(cube, max_spheres=20, min_radius=0.15).errors.volume) < 1e-3
    assert fit_clump(cube, max_spheres=5, max_radius=0.1).errors.volume < -0.5


def test_an_exact_shape_has_no_error():
    sphere = vg.make_shape("sphere")
    assert fit_clump(sphere, target="surface", value=1e-6).errors.surface_max == 0.0
    true = fit_clump(vg.make_shape("box"), max_spheres=5).to_shape()
    assert fit_clump(true).errors.inertia == 0.0
