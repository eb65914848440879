"""Files of packings keep what generators note about shapes."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError
from voxgran.io.files import load, save
from voxgran.io.record import from_record, to_record
from voxgran.io.shape_record import MOST_BYTES, planes_of, record_as_json, record_of_json, rows_of
from voxgran.shapes.generating.record import Record
from voxgran.shapes.mesh import LatticePoints
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

NOTED = {
    "heights": np.arange(12, dtype=np.int32).reshape(3, 4),
    "field": np.array([1 / 3, np.nan, -np.inf, -0.0, 5e-324]),
    "mask": np.array([[True], [False]]),
    "nothing": np.zeros((0, 3)),
    "scalar": np.array(0.1),
    "plain": 0.1,
    "whole": 2**60,
    "flag": True,
    "missing": None,
    "text": "Wärme",
    "nested": (1, (2.5, "a"), (np.array([1.0, 2.0]),)),
}


def assert_equal_values(one, other):
    """Equal in type and to the last bit."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_equal_values(a, b)
    else:
        assert one == other


def packing_of(*shapes):
    count = len(shapes)
    box = vg.Box((4.0 * count, 4.0, 4.0))
    place = np.array([[4.0 * k + 2.0, 2.0, 2.0] for k in range(count)]).reshape(-1, 3)
    return vg.Packing.of(shapes, box, position=place, shape_id=np.arange(count))


def test_records_make_a_round_trip(tmp_path):
    noted = Shape(Primitive("box", (1.0, 1.0, 1.0)), "noted", record=NOTED)
    rain = vg.make_shape("voxel_rain", seed=1)
    saved = packing_of(noted, rain, vg.make_shape("sphere"))
    save(saved, tmp_path / "p.vtp")
    shapes = load(tmp_path / "p.vtp").shapes
    for before, after in zip(saved.shapes, shapes, strict=True):
        assert list(before.record) == list(after.record)
        for key, value in before.record.items():
            assert_equal_values(value, after.record[key])
    assert not shapes[0].record["heights"].flags.writeable
    assert shapes[1].record["heights"].sum() > 0
    assert not shapes[2].record


def test_the_container_keeps_its_record(tmp_path):
    wall = vg.ClosedMesh(vg.make_shape("random_growth", seed=2, cubes=40, diameter=9.0))
    place = np.array([wall.shape.offset])
    saved = vg.Packing.of([vg.make_shape("sphere", diameter=0.1)], wall, position=place)
    save(saved, tmp_path / "p.vtp")
    again = load(tmp_path / "p.vtp").container.shape
    assert wall.shape.record
    for key, value in wall.shape.record.items():
        assert_equal_values(value, again.record[key])


def test_a_long_array_is_left_out():
    record = Record({"long": np.zeros(MOST_BYTES + 1, np.uint8), "in": (np.zeros(MOST_BYTES),), "short": 1})
    assert record_of_json(record_as_json(record)) == {"short": 1}
    most = Record({"most": np.zeros(MOST_BYTES, np.uint8)})
    assert len(record_of_json(record_as_json(most))["most"]) == MOST_BYTES


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"base64": "', '"base64": "?'),
        ('"shape": [3, 4]', '"shape": [3, 5]'),
        ('"dtype": "<i4"', '"dtype": "O"'),
        ('"dtype": "<i4", ', ""),
    ],
)
def test_a_damaged_record_is_refused(old, new):
    record = to_record(packing_of(Shape(Primitive("sphere", (0.5,)), record={"heights": NOTED["heights"]})))
    assert old in record.texts["shapes"]
    record.texts["shapes"] = record.texts["shapes"].replace(old, new)
    with pytest.raises(FileFormatError, match="it holds no packing of voxgran"):
        from_record(record)


def test_a_file_of_before_has_no_record():
    record = to_record(packing_of(vg.make_shape("sphere")))
    assert '"record"' not in record.texts["shapes"]
    assert not from_record(record).shapes[0].record


@pytest.mark.parametrize("count", [0, 1, 500])
def test_rows_of_whole_numbers_survive_as_bytes_that_can_be_compressed(count):
    draw = np.random.default_rng(count)
    far = draw.integers(-(2**30), 2**30, (count, 3)).astype(np.int32)
    near = np.cumsum(draw.integers(-9, 10, (count, 3)), axis=0).astype(np.int32)
    for parts in ([far], [near], [near[:1], near[1:], far]):
        rows = np.concatenate(parts)
        planes = planes_of(parts)
        assert planes.dtype == np.uint8
        assert planes.size == rows.nbytes
        assert np.array_equal(rows_of(planes), rows)
    # steps of less than 128 leave three of four bytes empty
    assert not planes_of([near])[3 * count :].any()


def test_surfaces_of_labels_take_fewer_bytes_and_survive(tmp_path):
    image = np.zeros((12, 12, 24), dtype=int)
    away = np.linalg.norm(np.stack(np.indices((12,) * 3), axis=-1) - 5.5, axis=-1)
    image[..., :12][away < 5], image[..., 12:][away < 5] = 1, 2
    packing = vg.packing_of_labels(image, voxel_size=(0.1, 0.3, 0.7), gravity="none")
    assert all(isinstance(shape.geometry.points, LatticePoints) for shape in packing.shapes)
    record = to_record(packing)
    assert record.arrays["format"] == [3]
    assert len(record.arrays["shape_points"]) == len(record.arrays["shape_faces"]) == 0
    assert from_record(record) == packing
    save(packing, tmp_path / "bed.vtp")
    again = load(tmp_path / "bed.vtp")
    assert again == packing
    for one, other in zip(packing.shapes, again.shapes, strict=True):
        assert_equal_values(one.vertices, other.vertices)
        assert_equal_values(one.geometry.points.steps, other.geometry.points.steps)
    # other steps are another shape
    record.arrays["shape_steps"] = record.arrays["shape_steps"].copy()
    record.arrays["shape_steps"][5] ^= 2
    with pytest.raises(FileFormatError, match="is not the one that was saved"):
        from_record(record)
