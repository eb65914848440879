"""The kernel decorator compiles late, links kernels to each other and keeps its cache by content."""

import subprocess
import sys

import numpy as np

from voxgran._base.kernels import Kernel, cache_folder, inlined_kernel, kernel
from voxgran._base.registry import Registry, unknown


@kernel
def _double(x):
    return 2.0 * x


@kernel
def _sum_of_doubles(values):
    total = 0.0
    for value in values:
        total += _double(value)
    return total


def test_kernels_call_kernels():
    assert isinstance(_sum_of_doubles, Kernel)
    assert _sum_of_doubles(np.arange(4.0)) == 12.0
    assert _sum_of_doubles.plain(np.arange(4.0)) == 12.0


@inlined_kernel
def _seventeen_times(x):
    total = 0.0
    for _ in range(17):
        total += x
    return total


@kernel
def _calls_what_is_inlined(x):
    return _seventeen_times(x) + 1.0


def test_inlined_kernels_give_what_others_give():
    assert _calls_what_is_inlined(2.0) == _calls_what_is_inlined.plain(2.0) == 35.0


def test_decorating_loads_no_numba():
    code = "import sys, voxgran.packing.bits, voxgran._base.seeds; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_cache_folder_can_be_written():
    assert cache_folder().is_dir()
    assert cache_folder() == cache_folder()


def test_unknown_names_get_the_nearest():
    assert unknown("method", "digitl", ["digital", "control_point"]) == (
        "method 'digitl' is unknown: did you mean 'digital'? known are control_point, digital"
    )
    assert Registry("tool", "voxgran._base", object, group="none").names()[:2] == ("arrays", "axes")
