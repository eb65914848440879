"""Motions of single bodies in the fall: free fall, inclined planes, rolling, impacts, against closed formulas."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.assembly import Assembly
from voxgran.settling.bed import Bed
from voxgran.settling.fall import fall_step
from voxgran.settling.impulses import Fall

SPHERE = vg.make_shape("sphere")
CUBE = vg.make_shape("box", lengths=(1.0, 1.0, 1.0))
#: farthest that a grain moves in a step here: no motion of these tests is faster
FAST = 0.4


def bed_of(shape, position, *, gravity=(0.0, 0.0, -1.0), lengths=(40.0, 6.0, 40.0), scale=None, velocity=None):
    """Return bodies at these places as a bed whose lengths are those of the arguments."""
    box = vg.Box(lengths)
    np.testing.assert_array_equal(box.bounds[0], 0.0)
    bed = Bed(Assembly.of([shape], box, position=position, scale=scale), np.array(gravity, dtype=float))
    if velocity is not None:
        bed.bodies[: bed.count, :3] = np.asarray(velocity, dtype=float)[bed.order]
    return bed


def fall(bed, time, *, before=0.0, friction=0.0, restitution=0.0, **options):
    """Let a bed fall for a time, with the impulses of the substep before, and return the duration of a substep."""
    how = Fall(friction, restitution, **{"most": FAST, "margin": 2 * FAST, **options})
    for _ in range(round(time / how.step)):
        fall_step(bed, how, before)
        before = how.step / how.substeps
    return before


def velocity(bed):
    """Return velocities and angular velocities in the order of the assembly, (n, 6)."""
    return bed.in_order(bed.bodies[: bed.count, :6])


def slope(angle):
    """Return gravity on a plane that falls along +x by an angle."""
    return np.array([np.sin(angle), 0.0, -np.cos(angle)])


def test_free_fall():
    """Velocities are exact; the way is that of the semi-implicit rule, first order in the substep."""
    bed = bed_of(SPHERE, [[5, 3, 30.0]])
    h = fall(bed, 2.0)
    np.testing.assert_allclose(velocity(bed)[0], [0, 0, -2.0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(30.0 - bed.poses()[0][0, 2], 0.5 * 2.0 * (2.0 + h), atol=1e-12)


def test_a_grain_falls_no_faster_than_the_limit():
    bed = bed_of(SPHERE, [[5, 3, 30.0]])
    fall(bed, 4.0, most=0.05)
    # the speed is limited before the acceleration of the last substep
    assert velocity(bed)[0, 2] == pytest.approx(-1.0, abs=0.0126)
    assert 30.0 - bed.poses()[0][0, 2] <= 4.0 + 0.05


@pytest.mark.parametrize("friction", [0.0, 0.2, 0.5])
def test_a_cube_slides_down_an_incline(friction):
    angle = 0.6
    bed = bed_of(CUBE, [[3, 3, 0.5005]], gravity=slope(angle))
    warm = fall(bed, 1.0, friction=friction)
    before = velocity(bed)[0]
    fall(bed, 1.0, before=warm, friction=friction)
    after = velocity(bed)[0]
    expected = np.sin(angle) - friction * np.cos(angle)
    assert after[0] - before[0] == pytest.approx(expected, rel=1e-3)
    np.testing.assert_allclose(after[1:], 0.0, atol=1e-3)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_cube_slips_at_the_angle_of_friction(friction):
    """It sticks at a slope a thousandth below the friction, and slips at one a thousandth above it."""
    for part in (1 - 1e-3, 1 + 1e-3):
        angle = np.arctan(part * friction)
        bed = bed_of(CUBE, [[3, 3, 0.5005]], gravity=slope(angle))
        # the impulses of the four corners are not equal at first
        warm = fall(bed, 6.0, friction=friction)
        before = velocity(bed)[0, 0]
        fall(bed, 6.0, before=warm, friction=friction)
        after, slip = velocity(bed)[0, 0], np.sin(angle) - friction * np.cos(angle)
        if part < 1:
            assert abs(after) < 1e-12
        else:
            assert (after - before) / 6.0 == pytest.approx(slip, rel=1e-3)


@pytest.mark.parametrize("angle", [0.2, 0.6])
def test_a_sphere_rolls_down_an_incline(angle):
    """With friction above 2/7 of the slope it rolls without sliding: 5/7 of the acceleration of free motion."""
    bed = bed_of(SPHERE, [[3, 3, 0.5005]], gravity=slope(angle))
    warm = fall(bed, 1.0, friction=1.0)
    before = velocity(bed)[0]
    fall(bed, 2.0, before=warm, friction=1.0)
    after = velocity(bed)[0]
    assert (after[0] - before[0]) / 2.0 == pytest.approx(5 / 7 * np.sin(angle), rel=1e-2)
    # the point of contact stands still
    assert after[4] * 0.5 == pytest.approx(after[0], rel=1e-2)


def test_a_sphere_slides_and_spins_down_a_steep_incline():
    """With less friction it slides, and its spin grows by 5/2 of the tangential acceleration over the radius."""
    angle, friction = 0.9, 0.1
    bed = bed_of(SPHERE, [[3, 3, 0.5005]], gravity=slope(angle))
    warm = fall(bed, 1.0, friction=friction)
    before = velocity(bed)[0]
    fall(bed, 2.0, before=warm, friction=friction)
    change = (velocity(bed)[0] - before) / 2.0
    assert change[0] == pytest.approx(np.sin(angle) - friction * np.cos(angle), rel=2e-3)
    assert change[4] * 0.5 == pytest.approx(2.5 * friction * np.cos(angle), rel=2e-3)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.7, 1.0])
def test_impact_on_a_wall(restitution):
    bed = bed_of(SPHERE, [[5, 3, 5.0]], velocity=[[0, 0, -2.0]])
    bed.gravity[:] = 0.0
    fall(bed, 3.0, restitution=restitution)
    np.testing.assert_allclose(velocity(bed)[0], [0, 0, 2.0 * restitution, 0, 0, 0], atol=1e-3)


def test_no_rebound_when_it_falls_again_and_again():
    """The heights of the rebounds of a dropped sphere fall by the square of the restitution."""
    e, rise = 0.7, []
    bed = bed_of(SPHERE, [[5, 3, 2.5]])
    how = Fall(0.0, e, most=FAST, margin=2 * FAST)
    heights, before = [], 0.0
    for _ in range(200):
        fall_step(bed, how, before)
        before = how.step / how.substeps
        heights.append(bed.poses()[0][0, 2] - 0.5)
    heights = np.array(heights)
    peaks = heights[1:-1][(heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:])]
    rise = peaks[peaks > 0.1]
    assert len(rise) >= 3
    np.testing.assert_allclose(rise[1:] / rise[:-1], e * e, rtol=0.05)
    assert rise[0] == pytest.approx(2.0 * e * e, rel=0.03)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_central_impact_of_two_spheres(restitution):
    """Momentum is kept, and the relative velocity turns by the restitution."""
    scale, speed = np.array([1.0, 1.5]), np.array([[1.5, 0, 0], [-1.0, 0, 0]])
    bed = bed_of(SPHERE, [[10, 3, 20], [14, 3, 20]], scale=scale, velocity=speed)
    bed.gravity[:] = 0.0
    fall(bed, 2.0, restitution=restitution)
    found, mass = velocity(bed), scale**3
    np.testing.assert_allclose(mass @ found[:, :3], mass @ speed, atol=1e-12)
    assert found[1, 0] - found[0, 0] == pytest.approx(restitution * 2.5, abs=1e-3)
    np.testing.assert_allclose(found[:, 1:], 0.0, atol=1e-12)


@pytest.mark.parametrize("restitution", [0.0, 1.0])
def test_oblique_impact_of_two_spheres_without_friction(restitution):
    """The velocities along the line of centers change, those across it do not; with restitution 1 energy is kept."""
    offset, speed = 0.6, np.array([[1.5, 0, 0], [0.0, 0, 0]])
    bed = bed_of(SPHERE, [[10, 3, 20], [13, 3 + offset, 20]], velocity=speed)
    bed.gravity[:] = 0.0
    # gaps count from no rest distance, and steps are short: the normal is that of the moment of contact
    fall(bed, 3.0, restitution=restitution, rest=0.0, step=0.005)
    found = velocity(bed)
    normal = np.array([np.sqrt(1 - offset**2), offset, 0.0])
    push = (1 + restitution) / 2 * 1.5 * normal[0] * normal
    np.testing.assert_allclose(found[:, :3], [speed[0] - push, push], atol=4e-3)
    np.testing.assert_allclose(found[:, :3].sum(axis=0), [1.5, 0, 0], atol=1e-12)


def test_friction_at_an_impact_on_a_wall():
    """A sphere that hits a wall without spin loses friction (1 + e) v of its velocity along the wall."""
    friction, e, speed = 0.1, 0.5, np.array([1.0, 0, -1.5])
    bed = bed_of(SPHERE, [[5, 3, 3.0]], velocity=[speed])
    bed.gravity[:] = 0.0
    fall(bed, 3.0, friction=friction, restitution=e)
    found, lost = velocity(bed)[0], friction * (1 + e) * 1.5
    np.testing.assert_allclose(found[[0, 2]], [1.0 - lost, e * 1.5], atol=1e-3)
    assert found[4] * 0.5 == pytest.approx(2.5 * lost, abs=3e-3)


def test_momentum_and_angular_momentum_of_free_bodies_are_kept():
    """A cloud of spheres collides with friction; no wall is near."""
    generator = np.random.Generator(np.random.Philox(5))
    position = 18.0 + 1.05 * np.array(list(np.ndindex(3, 3, 3)))
    speed = generator.normal(size=(27, 3)) - 0.5 * (position - position.mean(axis=0))
    bed = bed_of(SPHERE, position, lengths=(40.0, 40.0, 40.0), velocity=speed)
    bed.gravity[:] = 0.0
    start = bed.poses()[0]

    def momenta():
        found, place = velocity(bed), bed.poses()[0]
        spin = np.cross(place, found[:, :3]).sum(axis=0) + 0.1 * found[:, 3:].sum(axis=0)
        return found[:, :3].sum(axis=0), spin

    first = momenta()
    fall(bed, 2.0, friction=0.4, step=0.01, rest=0.0)
    last = momenta()
    assert np.abs(bed.poses()[0] - start).max() > 0.5
    np.testing.assert_allclose(last[0], first[0], atol=1e-10)
    # arms of a pair end on both surfaces, which are a gap apart
    np.testing.assert_allclose(last[1], first[1], atol=0.05)
