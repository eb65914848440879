"""Density of shapes: what is stored, what keeps it, and that settling and the balance of forces weigh grains by it."""

import dataclasses

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import CheckpointError, FileFormatError, InputError
from voxgran.contacts.assembly import as_density, shapes_by_density
from voxgran.io.record import to_record

STEEL, GLASS = 7800.0, 2500.0
SPHERE, CUBE = vg.shapes.sphere(), vg.shapes.box(lengths=(1, 1, 1))
BOX = vg.Box((4, 4, 4))


def pair(density=(STEEL, GLASS), **given):
    places = [(1, 1, 1), (3, 1, 1), (1, 3, 1)]
    return vg.Packing.of([SPHERE, CUBE], BOX, position=places, shape_id=[0, 1, 0], density=density, **given)


def column(lower, upper):
    """Return two touching spheres of diameter 1, one on the other, on the floor."""
    return vg.Packing.of(
        [SPHERE, SPHERE], vg.Box((3, 3, 3)), position=[(1.5, 1.5, 0.5), (1.5, 1.5, 1.5)], shape_id=[0, 1],
        density=[lower, upper],
    )  # fmt: skip


def bed(density, **given):
    asked = {"count": 60, "seed": 3, "friction": 0.4, **given}
    return vg.pack([SPHERE, SPHERE], vg.Box((4, 4, 12)), "gravity", density=density, **asked)


@pytest.mark.parametrize(
    ("density", "message"),
    [
        ([1.0], r"density is \[1.0\]: it must be one number, or 2, one for each shape"),
        ([1.0, 2.0, 3.0], "it must be one number, or 2, one for each shape"),
        ([], r"density is \[\]"),
        ([STEEL, 0], "density of shape 1 is 0: it must be finite and above 0; change it"),
        ([-1.0, GLASS], "density of shape 0 is -1.0: it must be finite and above 0; change it"),
        ([STEEL, float("nan")], "density of shape 1 is nan"),
        ([STEEL, float("inf")], "density of shape 1 is inf"),
        ([STEEL, True], "density of shape 1 is True: it must be a number"),
        ([STEEL, "glass"], "density of shape 1 is 'glass': it must be a number"),
        ([[STEEL], [GLASS]], "density of shape 0 is .*: it must be a number"),
        ({"steel": STEEL}, "density is .*: it must be one number or a list"),
        ("steel", "density is 'steel': it must be a number"),
        (0.0, "density is 0.0: it must be finite and above 0"),
        (None, "density is None"),
    ],
)
def test_bad_densities_are_refused(density, message):
    with pytest.raises(InputError, match=message) as caught:
        pair(density)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=message):
        dataclasses.replace(pair(), density=density)
    if density is not None:
        with pytest.raises(InputError, match=message):
            vg.pack([SPHERE, CUBE], BOX, "rsa", count=2, density=density)


def test_density_is_one_number_or_one_for_each_shape():
    assert (pair().density, pair(GLASS).density) == ((STEEL, GLASS), GLASS)
    # equal ones are one
    assert pair([GLASS, GLASS]).density == GLASS
    assert pair([GLASS, GLASS]) == pair(GLASS)
    assert pair(np.array([STEEL, GLASS])) == pair()
    assert pair() != pair((GLASS, STEEL))
    assert pair() != pair(STEEL)
    assert vg.Packing.of([], BOX, position=[], density=3).density == 3.0
    assert as_density((1, 2), 2) == (1.0, 2.0)


def test_masses_are_those_of_a_plain_sum():
    packing = pair(scale=[1.0, 0.5, 2.0])
    expected = [STEEL * np.pi / 6, GLASS * 0.5**3, STEEL * np.pi / 6 * 2**3]
    np.testing.assert_allclose(packing.masses, expected, rtol=1e-14)
    np.testing.assert_array_equal(packing.densities, [STEEL, GLASS, STEEL])
    mean = sum(expected) / (np.pi / 6 * 9 + 0.125)
    assert packing.mean_density == pytest.approx(mean, rel=1e-14)
    np.testing.assert_allclose(packing.relative_densities, packing.densities / mean, rtol=1e-14)
    assert pair(GLASS).relative_densities.tolist() == [1.0, 1.0, 1.0]
    assert pair()[[0, 2]].relative_densities.tolist() == [1.0, 1.0]
    empty = pair()[[]]
    assert (empty.masses.shape, empty.relative_densities.shape, empty.density) == ((0,), (0,), (STEEL, GLASS))
    with pytest.raises(ValueError, match="read-only"):
        packing.masses[0] = 2.0


def test_densities_stay_with_their_shapes():
    packing = pair()
    assert packing[1:].densities.tolist() == [GLASS, STEEL]
    assert packing[[2, 1]].density == (STEEL, GLASS)
    assert packing.to_unit("1").density == (STEEL, GLASS)
    clumps = packing.with_clumps(max_spheres=3)
    assert clumps.shapes[1] != CUBE
    assert clumps.densities.tolist() == packing.densities.tolist()
    assert vg.grow(packing).densities.tolist() == packing.densities.tolist()
    assert packing.to_dataframe().density.tolist() == [STEEL, GLASS, STEEL]
    assert "density" not in pair(GLASS).to_dataframe()


def test_packings_of_several_densities_are_put_together():
    packing = pair()
    assert packing[:1] + packing[1:] == packing
    # one shape of two materials is there twice
    both = pair(STEEL) + pair(GLASS)
    assert both.densities.tolist() == [STEEL] * 3 + [GLASS] * 3
    assert both.shapes == (SPHERE, CUBE, SPHERE, CUBE)
    assert both[:3] == pair(STEEL)
    assert (pair(GLASS) + pair(GLASS)).density == GLASS


def test_inscribed_grains_have_the_densities_of_their_spheres():
    spheres = vg.Packing.of([SPHERE, SPHERE], BOX, position=pair().position, shape_id=[0, 1, 0], density=[STEEL, GLASS])
    found = vg.inscribe(spheres, [CUBE, vg.shapes.cylinder(radius=0.5, height=1)], shape_id=[0, 0, 1])
    assert found.densities.tolist() == [STEEL, GLASS, STEEL]
    assert [found.shapes[k].name for k in found.shape_id] == ["box", "box", "cylinder"]
    assert vg.verify(found).ok
    assert vg.inscribe(pair(GLASS)[[0, 2]], CUBE).density == GLASS


def test_shapes_by_density_is_a_grouping():
    shapes, shape_id, density = shapes_by_density([SPHERE, CUBE], np.array([1, 0, 1, 0]), [2.0, 3.0, 3.0, 3.0])
    assert [(shapes[k].name, density[k]) for k in shape_id] == [("box", 2), ("sphere", 3), ("box", 3), ("sphere", 3)]
    assert len(shapes) == 3
    assert shapes_by_density([SPHERE], np.zeros(2, int), [3.0, 3.0])[2] == 3.0


def test_cells_have_the_densities_of_their_grains():
    sizes = [vg.shapes.sphere(diameter=0.5), vg.shapes.sphere(diameter=1.0)]
    made = vg.pack(sizes, vg.Box((6, 6, 6)), "voronoi_fill", count=40, density=[STEEL, GLASS])
    heavy = made.densities == STEEL
    assert 5 < heavy.sum() < 35
    # the cells of small ones are smaller
    assert made.volumes[heavy].mean() < made.volumes[~heavy].mean()


def test_a_start_keeps_its_densities():
    box = vg.Box((6, 6, 12))
    start = vg.pack([SPHERE, SPHERE], box, "rsa", count=8, density=[STEEL, GLASS], seed=1)
    more = vg.pack(CUBE, box, "rsa", count=4, density=1000, start=start)
    assert more.densities.tolist() == [*start.densities.tolist(), *[1000.0] * 4]
    with pytest.raises(InputError, match=r"density is left out and grains of start have 7800, 2500.*give theirs"):
        vg.pack(CUBE, box, "rsa", count=4, start=start)
    with pytest.raises(InputError, match=r"density is \[1, 2\]: it must be one number, or 1,"):
        vg.pack(CUBE, box, "rsa", count=4, start=start, density=[1, 2])
    assert vg.pack((), box, "rsa", start=start).density == (STEEL, GLASS)


def test_records_hold_densities_and_files_of_one_density_are_as_before(tmp_path):
    packing = pair()
    packing.save(tmp_path / "p.vtp")
    found = vg.load(tmp_path / "p.vtp")
    assert found == packing
    assert found.density == (STEEL, GLASS)
    assert to_record(packing).per_grain["density"].tolist() == [STEEL, GLASS, STEEL]
    # an older voxgran, which reads the layout 1, must not take the first for all
    assert to_record(packing).arrays["format"].tolist() == [2]
    one = to_record(pair(GLASS))
    assert (one.arrays["format"].tolist(), one.arrays["density"].tolist()) == ([1], [GLASS])
    assert "density" not in one.per_grain
    record = to_record(packing)
    record.arrays["density"] = np.array([1.0, 2.0, 3.0])
    with pytest.raises(FileFormatError, match="it must be one number, or 2"):
        vg.io.record.from_record(record)


@pytest.mark.parametrize(("lower", "upper"), [(STEEL, GLASS), (GLASS, STEEL), (1.0, 1e6)])
def test_the_floor_bears_the_weight_of_a_heavy_and_a_light_sphere(lower, upper):
    found = vg.equilibrium(column(lower, upper), friction=0.0)
    weight = {int(j): float(f) for j, f in zip(found.contact_j.values, found.normal_force.values, strict=True) if f}
    mean = (lower + upper) / 2
    assert weight[-1] == pytest.approx(2.0, abs=1e-3)
    assert weight[1] == pytest.approx(upper / mean, abs=1e-3)
    assert found.carried.values == pytest.approx([upper / lower, 0.0], rel=1e-6, abs=1e-3)
    assert found.rests.values.all()


@pytest.mark.parametrize("top", [GLASS, STEEL])
def test_a_disk_between_two_others_presses_the_walls_by_its_own_weight(top):
    """The contacts rise by 3 in 4: a wall bears 3/8 of the weight of the upper disk, the floor half of it."""
    disk = vg.shapes.disk()
    places = [(0.5, 0.5, 0), (1.7, 0.5, 0), (1.1, 1.3, 0)]
    packing = vg.Packing.of(
        [disk, disk], vg.Rectangle((2.2, 3)), position=places, shape_id=[0, 0, 1], density=[5000, top]
    )
    found = vg.equilibrium(packing, friction=0.0)
    mean = (2 * 5000 + top) / 3
    walls = found.contact_j.values == -1
    across, down = np.abs(found.force.values[walls][:, :2]).T
    assert across.max() == pytest.approx(0.375 * top / mean, abs=1e-3)
    assert down.max() == pytest.approx((5000 + top / 2) / mean, abs=1e-3)


def test_residuals_are_in_the_weight_and_the_radius_of_each_grain():
    """Two plates that tip over spheres, one of them six times as heavy, are as far from rest."""
    plate = vg.shapes.box(lengths=(3, 1, 0.2))
    places = [(2, 2, 0.5), (2.8, 2, 1.1), (2, 6, 0.5), (2.8, 6, 1.1)]
    packing = vg.Packing.of(
        [SPHERE, plate] * 2, vg.Box((6, 8, 4)), position=places, shape_id=range(4),
        density=[1000, 1000, 6000, 6000],
    )  # fmt: skip
    found = vg.equilibrium(packing, friction=0.5)
    torque, residual = found.residual_torque.values, found.residual.values
    assert torque[1] > 0.2
    assert torque[3] == pytest.approx(torque[1], rel=0.02)
    assert residual[3] == pytest.approx(residual[1], rel=0.02, abs=1e-3)


@pytest.mark.parametrize("lid", [None, {"weight": 0.5}])
def test_the_walls_bear_the_weight_of_a_bed_of_two_materials(lid):
    settled = bed([STEEL, GLASS], lid=lid)
    assert settled.stop_reason == "settled"
    forces = settled.forces
    # plain sum of masses, in weights of a grain of the median diameter and the mean density
    mass = sum(rho * np.pi / 6 for rho in settled.densities.tolist())
    weights = mass / (settled.mean_density * np.pi / 6)
    assert weights == pytest.approx(settled.count)
    on_walls = forces.force[forces.j == -1] @ np.array(settled.gravity)
    assert on_walls.sum() == pytest.approx(weights * (1.0 if lid is None else 1.5), rel=2e-3)
    again = vg.equilibrium(dataclasses.replace(settled, lid=None), friction=0.4)
    if lid is None:
        assert float(again.rests.mean()) > 0.95
    assert vg.verify(settled).ok


@pytest.mark.slow
def test_only_the_ratio_of_densities_matters():
    """Ten times all densities give the same bits, and so do equal ones and none."""
    one, ten = bed([STEEL, GLASS]), bed([10 * STEEL, 10 * GLASS])
    assert one.position.tobytes() == ten.position.tobytes()
    assert one.forces.force.tobytes() == ten.forces.force.tobytes()
    plain, equal, stated = bed(None), bed([GLASS, GLASS]), bed(STEEL)
    assert plain.position.tobytes() == equal.position.tobytes() == stated.position.tobytes()
    assert plain.position.tobytes() != one.position.tobytes()
    # what counts is the grains that are there: a shape without grains has no weight
    few = vg.pack([SPHERE, SPHERE], vg.Box((4, 4, 12)), "gravity", count=60, seed=3, friction=0.4, weights=[1, 0])
    alone = vg.pack([SPHERE, SPHERE], vg.Box((4, 4, 12)), "gravity", count=60, seed=3, friction=0.4, weights=[1, 0],
                    density=[STEEL, GLASS])  # fmt: skip
    assert few.position.tobytes() == alone.position.tobytes()


def test_a_run_does_not_go_on_with_other_densities(tmp_path):
    start = vg.Packing.of([SPHERE, SPHERE], vg.Box((3, 3, 8)), position=[(1, 1, 2), (2, 2, 4), (1, 2, 6)],
                          shape_id=[0, 1, 0], density=[STEEL, GLASS])  # fmt: skip
    where = {"checkpoint": tmp_path / "c", "resume": True}
    first = vg.settle(start, **where)
    assert vg.settle(start, **where).position.tobytes() == first.position.tobytes()
    with pytest.raises(CheckpointError):
        vg.settle(dataclasses.replace(start, density=(GLASS, STEEL)), **where)


def test_scenes_state_densities_beside_their_shapes():
    shapes = [{"family": "sphere", "density": 7800}, {"family": "sphere", "diameter": 2.0}]
    rest = {"container": {"kind": "box", "lengths": [6, 6, 6]}, "packing": {"method": "rsa", "count": 6}}
    with pytest.raises(
        InputError, match=r"\[\[shape\]\] sphere has no density, and another .* or give \[scene\] density"
    ):
        vg.Scene.from_mapping({"shape": shapes, **rest})
    made = vg.Scene.from_mapping({"scene": {"density": 2500}, "shape": shapes, **rest})
    assert made.density() == [7800, 2500]
    with pytest.raises(InputError, match=r"\[\[shape\]\] density is -1: it must be finite and above 0"):
        vg.Scene.from_mapping({"shape": [{"family": "sphere", "density": -1}], **rest})


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_heavy_grains_sink_when_a_settled_bed_is_shaken(seed):
    """Grains of steel among foam come lower; the same bed of one density hardly sorts itself."""
    start = vg.pack(
        [SPHERE, SPHERE], vg.Cylinder(2.0, 14), "gravity", count=80, density=[20, 1], friction=0.2, seed=seed
    )
    heavy = start.densities == 20

    def rise(packing):
        height = packing.position[:, 2]
        return height[heavy].mean() - height[~heavy].mean()

    shaking = {"acceleration": 5.0, "duration": 60.0}
    apart, alike = (
        rise(vg.settle(one, friction=0.1, shaking=shaking, seed=seed)) - rise(start)
        for one in (start, dataclasses.replace(start, density=1.0))
    )
    assert apart < -0.5
    assert abs(alike) < 0.4
