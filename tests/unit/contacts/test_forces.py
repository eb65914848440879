"""Forces at contacts: what is accepted, and what a packing does with them."""

import copy
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from kit import column

from voxgran._base.errors import InputError
from voxgran.contacts.forces import ContactForces, chain_ends, partner_images
from voxgran.containers.kinds.box import Box
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
ARRAYS = tuple(entry.name for entry in fields(ContactForces) if entry.name not in ("friction", "stress"))


def some(**changes):
    """Return the forces of two grains, of which the first lies on a wall and bears the second."""
    given = {
        "i": [0, 1],
        "j": [-1, 0],
        "point": [[1, 1, 0], [1, 1, 1]],
        "normal": [[0, 0, -1], [0, 0, -1]],
        "force": [[0, 0, -2], [0.3, 0.4, -1]],
        "gap": [0.0, 1e-3],
        "residual": [0.0, 0.5],
        "rattler": [False, True],
        "friction": 0.5,
    }
    return ContactForces(**{**given, **changes})


def test_parts_of_a_force():
    forces = some()
    assert forces.count == 2
    assert forces.normal_force.tolist() == [2.0, 1.0]
    assert forces.tangential_force == pytest.approx([0.0, 0.5])
    assert forces.magnitude == pytest.approx([2.0, 1.25**0.5])
    assert forces.largest_force() == pytest.approx([2.0, 1.25**0.5])
    assert (forces.share_at_rest, forces.share_of_rattlers) == (0.5, 0.5)
    assert some(force=[[0, 0, -2], [0, 0, -1e-5]]).carries.tolist() == [True, False]
    assert not some(force=np.zeros((2, 3))).carries.any()


def test_no_contacts():
    names = ("i", "j", "point", "normal", "force", "gap")
    forces = some(**{name: [] for name in names}, residual=[1.0], rattler=[True])
    assert forces.point.shape == forces.force.shape == (0, 3)
    assert forces.largest_force().tolist() == [0.0]
    assert forces.share_at_rest == 0.0
    none = some(**{name: [] for name in ARRAYS})
    assert np.isnan([none.share_at_rest, none.share_of_rattlers]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"i": [0, 2]}, "i is 2 at index 1: it must be the index of a grain, a whole number below 2;"),
        ({"i": [0, -1]}, "i is -1 at index 1"),
        ({"j": [-1, 0.5]}, "j is 0.5 at index 1: .* -1 for a wall or -2 for the lid"),
        ({"j": [-3, 0]}, "j is -3 at index 0"),
        ({"j": [0]}, r"j has shape \(1,\)"),
        ({"point": [[0, 0, 0]]}, r"point has shape \(1, 3\)"),
        ({"normal": [[0, 0, -1], [0, 0, -2]]}, "normal has length 2 at row 1: it must be 1"),
        ({"force": [[0, 0, np.inf], [0, 0, 0]]}, "force is inf"),
        ({"gap": [0.0, np.nan]}, "gap is nan"),
        ({"residual": [0.0, -1.0]}, "residual is -1 for grain 1: it must be at least 0"),
        ({"rattler": [True]}, r"rattler has shape \(1,\)"),
        ({"rattler": [0, 2]}, "rattler has shape .* type int64"),
        ({"friction": -0.1}, "friction is -0.1"),
    ],
)
def test_what_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        some(**changes)


def test_arrays_are_copied_and_read_only():
    gap = np.array([0.0, 1e-3])
    forces = some(gap=gap)
    gap[0] = 7.0
    assert forces.gap[0] == 0.0
    for one in (forces, copy.deepcopy(forces), pickle.loads(pickle.dumps(forces)), replace(forces, friction=None)):
        for name in ARRAYS:
            assert not getattr(one, name).flags.writeable
            assert getattr(one, name).tobytes() == getattr(forces, name).tobytes()
        with pytest.raises(AttributeError):
            one.friction = 1.0
    assert pickle.loads(pickle.dumps(column(3))).forces.force.tolist() == column(3).forces.force.tolist()


def test_a_packing_checks_its_forces():
    packing = column(3)
    assert packing.forces.friction == 0.5
    assert Packing.of([BALL], packing.container, position=packing.position).forces is None
    with pytest.raises(InputError, match="forces are those of 3 grains: the packing has 2"):
        Packing.of([BALL], packing.container, position=packing.position[:2], forces=packing.forces)
    with pytest.raises(InputError, match="forces are of type dict"):
        replace(packing, forces={})
    with pytest.raises(InputError, match="the packing has 0; set forces to None"):
        replace(
            packing, **{name: getattr(packing, name)[:0] for name in ("position", "orientation", "scale", "shape_id")}
        )


def test_forces_follow_the_unit():
    packing = column(3, unit="m")
    converted = packing.to_unit("mm")
    assert np.array_equal(converted.forces.point, 1000 * packing.forces.point)
    assert np.array_equal(converted.forces.force, packing.forces.force)
    assert some().scaled(1000.0).gap.tolist() == [0.0, 1.0]
    assert column(3).to_unit("1").forces is not None


def test_forces_of_a_compression_have_its_units():
    assert (some().unit, some().unit_of_residual) == ("weights of a median grain", "weights of the grain")
    pressed = some(stress=np.eye(3))
    assert (pressed.unit, pressed.unit_of_residual) == ("units of stress and median diameter", "mean normal forces")


def test_forces_are_those_of_all_grains():
    packing = column(4)
    assert packing[:].forces is packing.forces
    for some_grains in (packing[:3], packing[[3, 2, 1, 0]], packing[packing.position[:, 2] > 1], packing[[]]):
        assert some_grains.forces is None
    assert (packing + packing).forces is None
    assert replace(packing, density=2.0).forces is packing.forces


def test_forces_are_not_compared():
    packing = column(4)
    bare = replace(packing, forces=None)
    assert packing == bare
    assert hash(packing) == hash(bare)


def test_a_packing_says_what_rests():
    packing = column(4, stop_reason="settled")
    shown = replace(packing, forces=replace(packing.forces, residual=[0.0, 0.009, 0.01, 1.0]))
    assert repr(packing).endswith("settled, 100.0 % at rest)")
    assert repr(shown).endswith("settled, 50.0 % at rest)")
    assert "50.0 % of the grains, 0.0 % are rattlers" in shown._repr_html_()
    assert repr(replace(packing, forces=None)).endswith("settled)")
    none = {name: [] for name in ARRAYS}
    empty = Packing.of([BALL], packing.container, position=[], forces=some(**none), stop_reason="settled")
    assert repr(empty).endswith("settled)")


def test_lines_of_chains_reach_the_image_that_touches():
    box = Box((4, 4, 4), periodic="x", origin=(1, 0, 0))
    packing = Packing.of([BALL], box, position=[[1.25, 1, 0.5], [4.25, 1, 0.5], [3.5, 1, 0.5]])
    given = {"point": [[0.75, 1, 0.5], [4.75, 1, 0.5], [3.5, 1, 0]], "normal": [[-1, 0, 0], [1, 0, 0], [0, 0, -1]]}
    forces = some(
        i=[0, 1, 2],
        j=[1, 0, -1],
        **given,
        force=given["normal"],
        gap=[0, 0, 0],
        residual=[0, 0, 0],
        rattler=[False] * 3,
    )
    assert partner_images(packing, forces).tolist() == [[-1, 0, 0], [1, 0, 0], [0, 0, 0]]
    start, end = chain_ends(packing, forces)
    assert start.tolist() == packing.position.tolist()
    assert end.tolist() == [[0.25, 1, 0.5], [5.25, 1, 0.5], [3.5, 1, 0.0]]


def test_a_grain_that_touches_its_own_image():
    box = Box((1, 4, 4), periodic="x")
    packing = Packing.of([BALL], box, position=[[0.25, 1, 0.5]])
    one = {"point": [[0.75, 1, 0.5]], "normal": [[1, 0, 0]], "force": [[1, 0, 0]], "gap": [0]}
    forces = some(i=[0], j=[0], **one, residual=[0], rattler=[False])
    assert chain_ends(packing, forces)[1].tolist() == [[1.25, 1, 0.5]]
