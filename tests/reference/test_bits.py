"""The same bits on every processor: kept results, and processes in which libraries see another processor."""

import csv
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from jobs import reference_jobs

from voxgran.cli import bits

TABLE = Path(__file__).parent / "bits.csv"
JOBS = reference_jobs()
with TABLE.open() as lines:
    KEPT = {row["job"]: row["bits"] for row in csv.DictReader(lines)}

#: what NumPy looks for in a processor beyond what it was built for
FEATURES = " ".join(np._core._multiarray_umath.__cpu_dispatch__)
WITHOUT = {"NPY_DISABLE_CPU_FEATURES": FEATURES}
#: another processor for one library each, and threads
PROCESSORS = {
    "all at once": {"OPENBLAS_CORETYPE": "Nehalem", "OMP_NUM_THREADS": "2", **WITHOUT},
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "Zen": {"OPENBLAS_CORETYPE": "Zen"},
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX"},
    "NumPy's baseline": WITHOUT,
    "two threads": {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
    "numba's znver3": {"NUMBA_CPU_NAME": "znver3"},
}
PROGRAM = """
import json, sys, warnings
from jobs import reference_jobs
from voxgran.cli.bits import digest
jobs, found = reference_jobs(), {}
with warnings.catch_warnings(action="ignore"):
    for name in json.load(sys.stdin):
        found[name] = digest(jobs[name]())
print(json.dumps(found))
"""


def in_a_process(names, environment):
    paths = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM],
        input=json.dumps(names),
        stdout=subprocess.PIPE,
        check=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths, **environment},
    )
    return json.loads(ended.stdout)


@pytest.mark.exact_start("it compares the bits of a run with those that were kept")
@pytest.mark.parametrize("name", JOBS)
def test_results_have_the_bits_that_were_kept(name):
    with warnings.catch_warnings(action="ignore"):
        found = bits.digest(JOBS[name]())
    if found != KEPT[name] and (others := bits.other_versions()):
        pytest.skip(f"the bits were kept with other versions than {others}")
    assert found == KEPT[name]


def test_bits_are_kept_of_the_jobs_that_there_are():
    assert list(KEPT) == list(JOBS)
    assert len(KEPT) >= 60
    assert {name: KEPT[name] for name in bits.jobs()} == bits.REFERENCE


def test_a_quarter_of_the_jobs_has_the_same_bits_as_on_an_old_processor():
    names = list(JOBS)[::4]
    with warnings.catch_warnings(action="ignore"):
        expected = {name: bits.digest(JOBS[name]()) for name in names}
    assert in_a_process(names, PROCESSORS["all at once"]) == expected


@pytest.mark.slow
@pytest.mark.parametrize("processor", PROCESSORS)
def test_all_jobs_have_the_same_bits_on_other_processors(processor):
    names = list(JOBS)
    assert in_a_process(names, PROCESSORS[processor]) == in_a_process(names, {"OMP_NUM_THREADS": "1"})


def test_other_bits_are_told():
    one = {"x": np.array([1.0, -0.0])}
    assert bits.digest(one) == bits.digest({"x": np.array([1.0, 0.0])})
    others = ({"x": np.array([1.0 + 2**-52, 0.0])}, {"y": one["x"]}, {"x": one["x"][:, None]})
    assert bits.digest(one) not in map(bits.digest, others)
