"""Measure what the vector instructions of digital packing gain over plain loops: vector_speed.py FILE.csv

Scenes are packed twice, each time in a process of its own: with `voxgran.packing.digital.simd`, and with plain loops in
its place, which numba compiles. Both give the same packing. Seconds are CPU seconds, after a first call, the
smallest of three.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from benchmarks.model import arguments, write_rows
from voxgran._base.kernels import bare_kernel
from voxgran.packing.digital import simd

#: edge of a voxel, in diameters: columns of one word, and of several
VOXELS = (0.05, 0.012)


@bare_kernel
def shifted(high, low, shift):
    """Return the upper word of two that are shifted up."""
    return (high << shift) | ((low >> (np.uint64(63) - shift)) >> np.uint64(1))


@bare_kernel
def meets_lanes(bits, here, under, old, old_under, canvas, cell, shift, old_shift):
    """Return what the vector instructions of this name return."""
    met = np.uint8(0)
    for k in range(np.uint64(0), np.uint64(simd.LANES), np.uint64(1)):
        new = shifted(bits[here + k], bits[under + k], shift)
        gone = shifted(bits[old + k], bits[old_under + k], old_shift)
        met |= np.uint8(new & ~gone & canvas[cell + k] != 0)
    return met


@bare_kernel
def meets_low_lanes(bits, here, part, old, old_part, canvas, cell, shift, old_shift):
    """Return what the vector instructions of this name return."""
    met = np.uint8(0)
    for k in range(np.uint64(0), np.uint64(simd.LANES), np.uint64(1)):
        new = shifted(bits[here + k], bits[here + k], shift) & part
        gone = shifted(bits[old + k], bits[old + k], old_shift) & old_part
        met |= np.uint8(new & ~gone & canvas[cell + k] != 0)
    return met


@bare_kernel
def flip_lanes(bits, here, under, old, old_under, canvas, cell, shift, old_shift):
    """Flip what the vector instructions of this name flip."""
    for k in range(np.uint64(0), np.uint64(simd.LANES), np.uint64(1)):
        new = shifted(bits[here + k], bits[under + k], shift)
        canvas[cell + k] ^= new ^ shifted(bits[old + k], bits[old_under + k], old_shift)


@bare_kernel
def flip_low_lanes(bits, here, part, old, old_part, canvas, cell, shift, old_shift):
    """Flip what the vector instructions of this name flip."""
    for k in range(np.uint64(0), np.uint64(simd.LANES), np.uint64(1)):
        new = shifted(bits[here + k], bits[here + k], shift) & part
        canvas[cell + k] ^= new ^ (shifted(bits[old + k], bits[old + k], old_shift) & old_part)


def measure(loops):
    """Write the seconds and a hash of each packing to the standard output."""
    if loops == "plain":
        for function in (meets_lanes, meets_low_lanes, flip_lanes, flip_low_lanes):
            setattr(simd, function.__name__, function)
    import voxgran as vg

    rock = vg.make_shape("convex_polyhedron", seed=1)
    for voxel in VOXELS:
        seconds = []
        for _ in range(4):
            began = time.process_time()
            bed = vg.pack(rock, vg.Box((5, 5, 8)), "digital", count=60, voxel_size=voxel, seed=1, settle=False)
            seconds.append(time.process_time() - began)
        sys.stdout.write(f"{min(seconds[1:])} {hashlib.sha256(bed.position.tobytes()).hexdigest()}\n")


def main(target):
    """Write the table."""
    results = {}
    for loops in ("vector", "plain"):
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, __file__, os.devnull, loops]
            environment = {**os.environ, "VOXGRAN_CACHE": cache}
            answer = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
        results[loops] = [line.split() for line in answer.splitlines()]
    head, rows = "voxel_size_over_diameter,vector_seconds,plain_seconds,plain_over_vector", []
    for voxel, vector, plain in zip(VOXELS, results["vector"], results["plain"], strict=True):
        assert vector[1] == plain[1], "the packings differ"
        a, b = float(vector[0]), float(plain[0])
        rows.append((voxel, f"{a:.3f}", f"{b:.3f}", f"{b / a:.2f}"))
    write_rows(target, head, rows)


if __name__ == "__main__":
    target, loops = arguments(__doc__, "file", loops="")
    if loops:
        measure(loops)
    else:
        main(target)
