"""Tables of benches: the yardstick, and seconds and rates in units of it."""

import csv
import time

import numpy as np

from benchmarks import model


def table(tmp_path, head, *rows):
    """Return the rows of a table by column."""
    with model.write_rows(tmp_path / "table.csv", head, rows).open(newline="") as file:
        return list(csv.DictReader(file))


def test_seconds_and_rates_in_units_of_the_yardstick(tmp_path):
    head = "program,seconds,attempts_per_second,microseconds_per_attempt,calibration_seconds"
    first, second = table(tmp_path, head, '"SciPy, plain",3.0,200,5,0.25', ("voxgran", "", "", "", 0.25))
    assert first["program"] == "SciPy, plain"
    found = ("seconds_over_calibration", "attempts_per_calibration", "microseconds_per_attempt_over_calibration")
    assert [float(first[name]) for name in found] == [12.0, 50.0, 2e-5]
    assert [second[name] for name in found] == ["", "", ""]


def test_tables_without_the_yardstick_get_it_and_those_without_times_do_not(tmp_path, monkeypatch):
    monkeypatch.setattr(model, "calibration", lambda: 0.5)
    (row,) = table(tmp_path, "shape,seconds", "cube,2")
    assert (float(row["calibration_seconds"]), float(row["seconds_over_calibration"])) == (0.5, 4.0)
    (tmp_path / "table.csv").unlink()
    assert table(tmp_path, "shape,error", "cube,2") == [{"shape": "cube", "error": "2"}]


def test_values_are_written_in_the_format_of_their_column(tmp_path):
    head = "shape,apart,error:.2e,grains,ratio:.1f"
    first, second = table(tmp_path, head, ("cube, small", np.True_, 0.00123, 12, 2.0), ("cone", False, None, 3, np.nan))
    assert first == {"shape": "cube, small", "apart": "true", "error": "1.23e-03", "grains": "12", "ratio": "2.0"}
    assert second == {"shape": "cone", "apart": "false", "error": "", "grains": "3", "ratio": ""}


def test_the_yardstick_is_processor_time_of_a_distance_transform(monkeypatch):
    sizes = []

    def counted(solid):
        sizes.append((solid.shape, solid.dtype))
        began = time.process_time()
        while time.process_time() - began < 1e-3:
            pass
        time.sleep(0.05)

    monkeypatch.setattr("scipy.ndimage.distance_transform_edt", counted)
    # a sleep is none of it
    assert 1e-3 <= model.calibration() < 0.05
    assert set(sizes) == {((128, 128, 128), np.dtype(bool))}


def test_rates_are_of_cpu_seconds(monkeypatch):
    monkeypatch.setattr(time, "process_time", iter([0.0, 2.0, 10.0, 11.0]).__next__)
    assert model.best_rate(lambda: "made", 6, least_time=0.0) == (6.0, ["made", "made"])
