"""The time of imports and of compilation is counted once, and nothing else is."""

import time

from voxgran._base.kernels import kernel
from voxgran._base.lazy import counting_preparation, preparing


def compute(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def test_nested_preparation_is_counted_once():
    with preparing():
        compute(0.01)
    with counting_preparation() as count:
        compute(0.05)
        with preparing():
            compute(0.02)
            with preparing():
                compute(0.02)
    assert 0.04 <= count.seconds < 0.07


def test_compilation_of_a_kernel_is_counted():
    @kernel
    def twice(x):
        return x + x

    with counting_preparation() as count:
        began = time.process_time()
        assert twice(3) == 6
        whole = time.process_time() - began
        first = count.seconds
        assert twice(4) == 8
    assert 0.5 * whole < first <= whole
    assert count.seconds == first
