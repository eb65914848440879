"""How busy a study of many small runs keeps the processors."""

import os
import time
from pathlib import Path

import pytest

import voxgran as vg


def children():
    """Return the processes that this one has started."""
    found = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    return {int(number) for path in found for number in path.read_text().split()}


def wanted(number):
    """Return the seconds in which a process computed, or could have if other programs had left it a processor."""
    running, waiting, _ = Path(f"/proc/{number}/schedstat").read_text().split()
    return (int(running) + int(waiting)) * 1e-9


@pytest.mark.slow
def test_a_thousand_small_runs_keep_two_processors_busy(tmp_path):
    base = {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [5, 5, 5], "periodic": ["x", "y", "z"]},
        "packing": {"method": "rsa", "count": 30},
        "measure": {"which": ["density", "coordination"]},
    }
    before = children()
    samples = []

    def sample(step):
        if step.done < step.total:
            samples.append((time.monotonic(), sum(map(wanted, children() - before))))

    made = vg.Study(base=base, axes={"packing.count": list(range(25, 35))}, seeds=100)
    began = time.monotonic()
    result = made.run(tmp_path / "o", workers=2, on_step=sample)
    assert result.computed == 1000
    assert not result.failures
    first, last = samples[0], samples[-1]
    steady = (last[1] - first[1]) / (2 * (last[0] - first[0]))
    whole = last[1] / (2 * (last[0] - began))
    assert steady > 0.85
    assert whole > 0.85
