"""The record of a packing and its hash."""

import hashlib
import json
import math

import numpy as np

from voxgran.containers.kinds.box import Box
from voxgran.measures.model import measure
from voxgran.measures.registered.provenance import content_hash
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")


def packed(position=(1, 1, 1), **record):
    """Return one grain with a record."""
    return Packing.of([BALL], Box((4, 4, 4)), position=[position], provenance=record, stop_reason="settled")


def test_times_are_told_but_not_hashed():
    slow = packed(method="digital", seed=3, timing={"wall_seconds": 9.5})
    fast = packed(method="digital", seed=3, timing={"wall_seconds": 2.5})
    assert content_hash(slow) == content_hash(fast)
    found = measure(slow, which=["provenance"])["provenance"]
    assert float(found.wall_seconds) == 9.5
    assert found.wall_seconds.attrs["units"] == "s"
    assert json.loads(str(found.not_hashed.values)) == {"timing": {"wall_seconds": 9.5}}
    assert str(found.stop_reason.values) == "settled"


def test_all_else_is_hashed():
    one = packed(method="digital", seed=3)
    others = [packed(method="digital", seed=4), packed((1, 1, 1.0000001), method="digital", seed=3), packed()]
    assert len({content_hash(p) for p in [one, *others]}) == 4


def test_the_hash_is_that_of_the_record():
    found = measure(packed(method="digital", sizes=np.array([1.0, 2.0]), count=np.int64(3)), which=[])["provenance"]
    text = str(found.record.values)
    assert hashlib.sha256(text.encode()).hexdigest() == str(found.content_hash.values)
    record = json.loads(text)
    assert record["provenance"] == {"method": "digital", "sizes": [1.0, 2.0], "count": 3}
    assert record["grains"]["count"] == 1
    assert record["shapes"] == [{"name": "sphere", "key": BALL.key}]


def test_without_a_time():
    assert math.isnan(float(measure(packed(), which=[])["provenance"].wall_seconds))
    assert float(measure(packed(wall_seconds=2.0), which=[])["provenance"].wall_seconds) == 2.0
