"""What each method makes of the grains of a start, and of which grains the solid fraction is."""

import re
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.packing.method import method_registry

SPHERE = vg.shapes.sphere()
BOX = vg.Box((4, 4, 5))
#: grains of a start of other sizes than the further ones
START = vg.Packing.of([SPHERE], BOX, position=[(1, 1, 0.6), (3, 3, 0.6)], scale=[1.2, 1.1])
QUICK = {"digital": {"voxel_size": 0.1}, "digital_fill": {"voxel_size": 0.1}, "digital_rsa": {"voxel_size": 0.1}}
PAGE = Path(__file__).parents[2] / "docs" / "guide" / "packing.md"


def packed(method, shapes=SPHERE, start=START, **asked):
    """Return a packing that begins with the start, before anything settles."""
    return vg.pack(shapes, start.container, method, start=start, settle=False, **asked, **QUICK.get(method, {}))


def test_the_table_of_the_guide_says_what_the_methods_declare():
    rows = re.findall(r"^\| `start` \| `(\w+)` \| (.*?) \|", PAGE.read_text(), flags=re.MULTILINE)
    told = {name: word for word, names in rows for name in re.findall(r"`(\w+)`", names)}
    assert told == {name: method_registry().get(name).start for name in vg.packing_methods()}


@pytest.mark.parametrize("method", vg.packing_methods())
def test_a_target_is_that_of_the_grains_after_those_of_the_start(method):
    entry = method_registry().get(method)
    asked = {"count": 4} if method in ("gravity", "jam") else {"solid_fraction": 0.05}
    if entry.start == "refused":
        with pytest.raises(InputError, match=rf"start has 2 grains, and method '{method}' .*: leave start out, or"):
            packed(method, **asked)
        return
    packing = packed(method, **asked)
    assert packing.provenance["missed"].get("solid_fraction", 0.0) == 0.0
    factor = packing.diameters[:2] / START.diameters
    assert factor[1] == pytest.approx(factor[0], rel=1e-12)
    if entry.start != "scaled":
        assert factor[0] == pytest.approx(1.0, rel=1e-12)
    if entry.start == "placed":
        assert packing.position[:2] == pytest.approx(START.position, abs=0.3 if "digital" in method else 1e-9)
    if "count" in asked:
        assert packing.count == 6
    else:
        # methods that place grains of given sizes, or make them, end with the grain by which they get beyond
        reached, last = packing.volumes[2:].sum() / BOX.volume, SPHERE.volume / BOX.volume
        assert 0.05 - 1e-9 <= reached <= 0.05 + (1e-9 if entry.sizing == "scaled" else last)


def test_grains_that_grow_leave_the_start_as_it_is():
    box = vg.Box((4, 4, 4), periodic="xyz")
    start = vg.Packing.of([SPHERE], box, position=[(1, 1, 1), (3, 3, 3)])
    more = packed("expand", start=start, solid_fraction=0.1)
    assert (more.diameters[:2] == start.diameters).all()
    assert more.solid_fraction - start.solid_fraction == pytest.approx(0.1, abs=1e-12)
    both = packed("expand", start=start, count=5, solid_fraction=0.2)
    assert both.count == 7
    assert (both.diameters[:2] == start.diameters).all()
    assert both.solid_fraction - start.solid_fraction == pytest.approx(0.2, abs=1e-12)
    # without other grains it is the start that grows
    assert packed("expand", (), start=start, solid_fraction=0.1).solid_fraction == pytest.approx(0.1, abs=1e-12)


def test_a_start_that_cannot_keep_its_sizes_is_told():
    box = vg.Box((4, 4, 4), periodic="xyz")
    start = vg.pack(SPHERE, box, "rsa", count=40, seed=1)
    with pytest.warns(PackingWarning) as found:
        packing = packed("expand", start=start, solid_fraction=0.4)
    assert any("the grains, those of the start too, have" in str(one.message) for one in found)
    missed = packing.provenance["missed"]["solid_fraction"]
    assert 0.4 - missed == pytest.approx(packing.volumes[40:].sum() / box.volume)
    assert np.ptp(packing.diameters[:40]) < 1e-12


def test_a_missed_solid_fraction_is_told_as_that_of_the_further_grains():
    box = vg.Box((4, 4, 4), periodic="xyz")
    start = vg.pack(SPHERE, box, "rsa", count=29, seed=1)
    with pytest.warns(PackingWarning, match=r"the solid fraction of the grains after those of the start is .* of 0\.3"):
        packed("rsa", start=start, solid_fraction=0.3)
