"""One unit of all lengths of a packing, wherever shapes, containers and packings meet."""

import dataclasses
import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from benchmarks.encounter import Encounter
from voxgran._base.errors import InputError, PackingWarning, UnknownNameError
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Lid
from voxgran.packing.draw import Request, draw_grains

BALL = vg.make_shape("sphere")


def cube(edge, unit=None):
    """Return a cube as a mesh."""
    whole = vg.make_shape("box", lengths=(edge,) * 3)
    return vg.Shape.from_mesh(whole.vertices, whole.faces, name="cube", unit=unit)


def thrown(shapes, container, **more):
    return vg.pack(shapes, container, **{"method": "rsa", "count": 6, **more})


@pytest.mark.parametrize("method", ["rsa", "expand", "advancing_front", "deposition", "digital", "gravity"])
@pytest.mark.parametrize("container", [vg.Box((4, 4, 9)), vg.Box((4.1, 4.3, 9.7), periodic="xy", origin=(0.3, -7, 1))])
def test_the_container_of_a_packing_is_the_given_one_to_the_last_digit(method, container):
    packing = vg.pack(vg.make_shape("sphere", diameter=1.3), container, method, count=8, seed=1)
    assert packing.container == container
    assert vg.verify(packing).ok


def test_a_packing_has_the_unit_of_its_shapes():
    packing = thrown(cube(1.0, "mm"), vg.Box((6, 6, 6)))
    assert packing.unit == "mm"
    assert thrown([cube(1.0, "mm"), BALL], vg.Box((6, 6, 6))).unit == "mm"
    assert thrown(BALL, vg.Box((6, 6, 6))).unit == "1"
    assert thrown(BALL, vg.Box((6, 6, 6)), unit="in").unit == "inch"
    made = vg.Packing.of([cube(1.0, "cm")], vg.Box((6, 6, 6)), position=[(3, 3, 3)])
    assert made.unit == "cm"


def test_shapes_of_other_units_are_converted_to_that_of_the_packing():
    pair = [cube(5.0, "mm"), cube(0.005, "m")]
    mixed = thrown(pair, vg.Box((30, 30, 30)), unit="mm")
    same = thrown([cube(5.0, "mm")] * 2, vg.Box((30, 30, 30)), unit="mm")
    assert {shape.unit for shape in mixed.shapes} == {"mm"}
    np.testing.assert_allclose(mixed.diameters, same.diameters, rtol=1e-14)
    np.testing.assert_allclose(mixed.position, same.position, atol=1e-9)
    metres = thrown(pair, vg.Box((0.03,) * 3), unit="m")
    np.testing.assert_allclose(metres.position * 1000, mixed.position, atol=1e-6)
    with pytest.raises(InputError, match="shapes have lengths in m and mm: give unit, that of all other lengths"):
        thrown(pair, vg.Box((30, 30, 30)))
    with pytest.raises(InputError, match="in m and mm"):
        vg.Packing.of(pair, vg.Box((30, 30, 30)), position=np.zeros((0, 3)))
    two = vg.Packing.of(pair, vg.Box((3, 3, 3)), position=[(1, 1, 1), (2, 2, 2)], shape_id=[0, 1], unit="cm")
    np.testing.assert_allclose(two.volumes, 0.125)


def test_a_container_of_its_own_unit_is_converted():
    drum = vg.ClosedMesh(cube(10.0, "cm"))
    packing = thrown(cube(10.0, "mm"), drum, unit="mm")
    assert packing.container.volume == pytest.approx(1e6)
    assert packing.container.shape.unit == "mm"
    np.testing.assert_allclose(packing.diameters, cube(10.0).diameter)
    assert vg.verify(packing).ok
    assert thrown(BALL, drum).unit == "cm"
    with pytest.raises(InputError, match="shapes and container have lengths in cm and mm"):
        thrown(cube(10.0, "mm"), drum)
    moved = vg.ClosedMesh(vg.Shape.from_mesh(cube(2.0).vertices + 5, cube(2.0).faces, unit="m")).to_unit("cm")
    np.testing.assert_allclose(moved.bounds, [[400] * 3, [600] * 3])


@pytest.mark.parametrize("unit", ["furlong", "mmm", "Km"])
def test_unknown_units_are_refused_everywhere(unit, tmp_path):
    calls = (
        lambda: thrown(BALL, vg.Box((6, 6, 6)), unit=unit),
        lambda: vg.Packing.of([BALL], vg.Box((6, 6, 6)), position=[(3, 3, 3)], unit=unit),
        lambda: cube(1.0, unit),
        lambda: vg.Cloud.of([(0, 0, 0)], unit=unit),
        lambda: cube(1.0, "mm").to_unit(unit),
        lambda: vg.Scene.from_mapping({**SCENE, "scene": {"unit": unit}}),
    )
    for call in calls:
        with pytest.raises(UnknownNameError, match=f"unit '{unit}' is unknown"):
            call()


SCENE = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [6, 6, 6]},
    "packing": {"method": "rsa", "count": 5},
    "measure": {"which": ["grains"]},
    "output": {"vtk": False, "statistics": False, "report": False},
}


def test_a_scene_gives_unit_and_density(tmp_path):
    general = {"unit": "\u00b5m", "density": 2.65}
    result = vg.Scene.from_mapping({**SCENE, "scene": general}).run(tmp_path / "r")
    assert (result.packing.unit, result.packing.density) == ("um", 2.65)
    assert result.packing.provenance["scene"]["scene"]["unit"] == "um"
    assert vg.load(tmp_path / "r" / "packing.vtp").unit == "um"


def test_density_is_that_of_the_start_unless_given():
    bed = thrown(BALL, vg.Box((6, 6, 6)), density=2.0)
    assert bed.density == 2.0
    assert thrown(BALL, vg.Box((6, 6, 6))).density == 1.0
    assert thrown(BALL, vg.Box((6, 6, 12)), start=bed).density == 2.0
    # grains of the start keep theirs, unless it is not stated
    assert thrown(BALL, vg.Box((6, 6, 12)), start=bed, density=3).density == (2.0, 3.0)
    assert thrown(BALL, vg.Box((6, 6, 12)), start=thrown(BALL, vg.Box((6, 6, 6))), density=3).density == 3.0
    with pytest.raises(InputError, match="density is 0: it must be finite and above 0"):
        thrown(BALL, vg.Box((6, 6, 6)), density=0)


def test_a_start_is_converted():
    bed = thrown(BALL, vg.Box((60, 60, 60)), unit="mm", sizes=vg.sizes.fixed(10))
    more = thrown([], vg.Box((6, 6, 12)), start=bed, unit="cm", count=None)
    np.testing.assert_allclose(more.position, bed.position / 10, rtol=1e-12)
    np.testing.assert_allclose(more.diameters, 1.0)
    assert thrown(BALL, vg.Box((60, 60, 90)), start=bed).unit == "mm"
    # the start decides where nothing is said: a cube of 1 cm has a diameter of 12.4 mm
    both = thrown(cube(1.0, "cm"), vg.Box((60, 60, 90)), start=bed, count=1)
    assert both.unit == "mm"
    assert both.diameters[-1] == pytest.approx(10 * cube(1.0).diameter)
    bare = thrown(BALL, vg.Box((6, 6, 6)))
    named = thrown([], vg.Box((6, 6, 8)), start=bare, unit="mm", count=None)
    np.testing.assert_allclose(named.position, bare.position)


def test_a_packing_in_another_unit_is_the_same_packing():
    sizes = vg.sizes.uniform(0.8, 1.2)
    bed = vg.pack(
        [cube(1.0, "cm"), BALL], vg.Box((5, 5, 5)), method="digital_fill", count=10, voxel_size=0.1, sizes=sizes
    )
    other = bed.to_unit("mm")
    assert (other.unit, other.gravity, other.stop_reason) == ("mm", bed.gravity, bed.stop_reason)
    assert other.provenance["converted"] == {"from": "cm", "to": "mm"}
    assert other.contact_gap == pytest.approx(10 * bed.contact_gap) == pytest.approx(1.0)
    assert other.solid_fraction == pytest.approx(bed.solid_fraction, rel=1e-13)
    assert (other.asked_sizes.low, other.asked_sizes.high) == pytest.approx((8.0, 12.0))
    np.testing.assert_allclose(other.diameters, 10 * bed.diameters)
    np.testing.assert_allclose(other.position, 10 * bed.position)
    np.testing.assert_allclose(other.container.bounds, 10 * bed.container.bounds)
    assert vg.verify(other).ok
    assert bed.to_unit("cm") is bed
    with pytest.raises(InputError, match="lengths without a unit cannot be converted to or from mm"):
        other.to_unit("1")
    pressed = dataclasses.replace(bed, lid=Lid(np.array([0.0, 0.0, 1.0]), 4.0))
    assert pressed.to_unit("mm").lid.level == 40.0
    in_drum = thrown(BALL, vg.ClosedMesh(cube(10.0)), unit="m").to_unit("cm")
    assert in_drum.container.volume == pytest.approx(1e9)


def test_inscribed_shapes_take_the_unit_of_the_spheres():
    spheres = thrown(BALL, vg.Box((60, 60, 60)), unit="mm", sizes=vg.sizes.fixed(10))
    plain = vg.inscribe(spheres, cube(1.0))
    for shape in (cube(1.0, "mm"), cube(0.3, "m")):
        grains = vg.inscribe(spheres, shape)
        assert grains.unit == "mm"
        np.testing.assert_allclose(grains.diameters, plain.diameters)
        assert vg.verify(grains).ok
    bare = thrown(BALL, vg.Box((6, 6, 6)))
    grains = vg.inscribe(bare, [cube(1.0, "mm"), cube(1.0, "m")])
    assert grains.unit == "1"
    assert {shape.unit for shape in grains.shapes} == {None}


def test_clumps_keep_the_unit():
    assert vg.fit_clump(cube(1.0, "mm"), max_spheres=4).to_shape().unit == "mm"


def test_measures_say_their_units():
    packing = thrown(cube(1.0, "mm"), vg.Box((6, 6, 6)))
    tree = vg.measure(packing, which=["grains"])
    assert tree["/grains"].volume.attrs["units"] == "mm^3"
    assert tree["/grains"].diameter.attrs["units"] == "mm"
    assert tree.attrs["unit"] == "mm"


def test_sizes_of_another_unit_than_the_container_are_suspected():
    with pytest.warns(
        PackingWarning, match=r"all 9 grains, of diameters up to 0.001, fill 5e-12 of .* 10 wide"
    ) as found:
        thrown(BALL, vg.Box((10, 10, 10)), count=9, sizes=vg.sizes.fixed(1e-3))
    assert "mistake of units" in str(found[0].message)
    with pytest.warns(PackingWarning, match=r"up to 2 mm, fill .* that is 4000 mm wide"):
        thrown(BALL, vg.Box((5000, 5000, 4000)), sizes=vg.sizes.fixed(2), unit="mm")
    mapping = {**SCENE, "sizes": {"kind": "fixed", "diameter": 0.001}}
    with pytest.warns(PackingWarning, match="mistake of units"):
        vg.Scene.from_mapping(mapping).plan()
    # few grains, or small ones, are no mistake
    thrown(BALL, vg.Box((60, 60, 60)), count=1)
    thrown(BALL, vg.Box((1000.0, 1000.0, 1.0)), count=9, sizes=vg.sizes.fixed(1e-2))
    thrown(BALL, vg.Box((1, 1, 1)), count=3000, sizes=vg.sizes.fixed(1e-3))


@pytest.mark.slow
def test_two_grains_that_meet_are_brought_to_one_unit():
    ways = [
        Encounter(cube(1.0, unit), cube(edge, other), spacing=0.3).first_contact((1, 0, 0))[0]
        for unit, edge, other in (("cm", 10.0, "mm"), ("cm", 1.0, None), (None, 1.0, None))
    ]
    assert ways == pytest.approx([ways[-1]] * 3)


def hard_lengths():
    """Return lengths of which a power rounds in another way in another unit, by the C library of this machine."""
    lengths, unit = stream(1, "lengths").uniform(0.3, 3.0, 20_000).tolist(), 2.0**-10
    return [x for x in lengths if any((x * unit) ** k != x**k * unit**k for k in (2, 3))][:12]


@pytest.mark.parametrize("kind", ["Cylinder", "Disk", "Sphere"])
def test_volumes_of_round_containers_have_the_same_bits_in_any_power_of_two(kind):
    def volume(length):
        return getattr(vg, kind)(*((length, length) if kind == "Cylinder" else (length,))).volume

    unit = 2.0**-10
    power = 2 if kind == "Disk" else 3
    assert [volume(x * unit) for x in hard_lengths()] == [volume(x) * unit**power for x in hard_lengths()]


@pytest.mark.parametrize("sizing", ["drawn", "scaled", "made"])
def test_drawn_grains_have_the_same_bits_in_any_power_of_two(sizing):
    """As many equal grains as just have the volume, of a common factor, and of sizes that the method makes."""

    def drawn(length, unit):
        shapes = [vg.make_shape("sphere", diameter=length).scaled(unit)]
        box = vg.Box((8 * length * unit,) * 3)
        sizes = None if sizing == "made" else vg.sizes.fixed(0.7 * length * unit)
        amount = {"count": 12} if sizing == "made" else {"solid_fraction": 12 * shapes[0].volume * 0.7**3 / box.volume}
        asked = Request(shapes, box, "rsa", sizes=sizes, **amount)
        return draw_grains(asked, surplus=False, stretches=False, sizing=sizing, own_shapes=False).diameter

    for length in hard_lengths():
        np.testing.assert_array_equal(drawn(length, 2.0**-10), drawn(length, 1.0) * 2.0**-10)


#: methods whose grains push each other or move by chance: a difference in the last digit grows from contact to contact
CHAOTIC = ("gravity", "compress", "jam", "expand", "control_point", "digital")


@pytest.mark.parametrize(
    "method",
    [
        slow(name) if name in ("digital", "jam", "multilayer") else name
        for name in vg.packing_methods()
        if name != "apollonian"
    ],
)
def test_a_scene_of_another_scale_is_the_same_packing(method):
    """Its bits for a power of two; otherwise to rounding, but for methods that enlarge it."""

    def packed(factor):
        shapes = [vg.make_shape("sphere", diameter=0.9).scaled(factor)]
        if method != "multilayer":
            shapes.append(vg.make_shape("convex_polyhedron", seed=2).scaled(factor))
        lengths = {"voxel_size": 0.15 * factor} if method.startswith("digital") else {}
        steps = {"sweeps": 20} if method in ("digital", "control_point") else {}
        ends = {"solid_fraction": 0.3} if method == "expand" else {}
        count = None if method == "multilayer" else 12
        box = vg.Box((4 * factor, 4 * factor, 5 * factor), periodic="xy")
        with warnings.catch_warnings(action="ignore", category=PackingWarning):
            packing = vg.pack(shapes, box, method, count=count, seed=3, **lengths, **steps, **ends)
        return np.column_stack([packing.position / factor, packing.orientation, packing.diameters / factor])

    one = packed(1.0)
    np.testing.assert_array_equal(packed(2.0**-10), one)
    if method not in CHAOTIC:
        np.testing.assert_allclose(packed(1e-3), one, rtol=0, atol=1e-9)
