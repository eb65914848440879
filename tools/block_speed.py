"""Measure time and memory of images in blocks: block_speed.py FOLDER EDGE FILE.csv [STEP ...] [--limit GIB]

The image has EDGE voxels along each axis and shows a packing of spheres of about 30 voxels, which touch. It is painted
by blocks and kept in FOLDER as zarr, where each step opens it in a process of its own. The file has a row for each
step: CPU seconds, nanoseconds of them for each voxel, and the largest memory of the process (without what lies in
files); what was found is printed. Steps: image, components, distance, thickness, segment, labels; default: all of them,
in this order. With a limit a step that takes more memory fails.
"""

import argparse
import math
import resource
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import voxgran as vg
from benchmarks.model import write_rows

VOXEL, BLOCK = 1 / 30, 128


def image(folder: Path, edge: int) -> str:
    """Pack, paint and keep the labels."""
    bed = vg.pack(
        vg.shapes.sphere(),
        vg.Box((edge * VOXEL,) * 3),
        "advancing_front",
        sizes=vg.sizes.uniform(0.7, 1.3),
        unit="mm",
        seed=1,
    )
    vg.save_image(
        vg.to_image(bed, VOXEL, block=BLOCK), folder / "labels.zarr", voxel_size=VOXEL, unit="mm", overwrite=True
    )
    return f"{bed.count} grains, solid fraction {bed.solid_fraction:.5f}"


def components(folder: Path, edge: int) -> str:
    """Count the bodies of the solid less a layer of three voxels."""
    del edge
    core = vg.erosion(vg.open_image(folder / "labels.zarr").values > 0, 3.0)
    return f"{vg.connected_components(core)[1]} bodies"


def distance(folder: Path, edge: int) -> str:
    """Find the largest distance in the pores."""
    del edge
    pores = vg.open_image(folder / "labels.zarr").values == 0
    return f"largest {float(vg.distance_transform(pores).max()):.2f} voxels"


def thickness(folder: Path, edge: int) -> str:
    """Find the mean width of the pores."""
    del edge
    pores = vg.open_image(folder / "labels.zarr").values == 0
    return f"mean {float(vg.local_thickness(pores).sum() / pores.sum()):.2f} voxels"


def segment(folder: Path, edge: int) -> str:
    """Part the grains of a grey image."""
    del edge
    opened = vg.open_image(folder / "labels.zarr")
    grey = vg.filter_image((opened.values > 0).astype(np.float32), gaussian_filter, sigma=1.0)
    return f"{vg.segment(grey, threshold=0.5, voxel_size=opened.voxel_size).grains} grains"


def labels(folder: Path, edge: int) -> str:
    """Make the packing of the labels."""
    del edge
    packing = vg.packing_of_labels(folder / "labels.zarr", gravity="none")
    # numbers of corners as they are kept, not as Python is given them
    faces = sum(len(shape.geometry.corners) for shape in packing.shapes)
    error = packing.provenance["largest_volume_error"]
    return (
        f"{packing.count} grains, {faces} triangles, solid fraction {packing.solid_fraction:.5f}, error of volumes "
        f"{error:.1e}"
    )


STEPS: dict[str, Callable[[Path, int], str]] = {
    step.__name__: step for step in (image, components, distance, thickness, segment, labels)
}


class Memory(threading.Thread):
    """Watches the memory of this process that is not a copy of what lies in files."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.most = 0

    def run(self) -> None:
        """Look every hundredth of a second."""
        while True:
            told = Path("/proc/self/status").read_text(encoding="ascii")
            self.most = max(self.most, int(told.partition("RssAnon:")[2].split()[0]) // 1024)
            time.sleep(0.01)


def main() -> None:
    """Run a step, or each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("edge", type=int)
    parser.add_argument("table", type=Path)
    parser.add_argument("steps", nargs="*", metavar="step")
    parser.add_argument("--limit", type=float, default=math.inf)
    given = parser.parse_args()
    if len(given.steps) != 1:
        rows = []
        for step in given.steps or STEPS:
            words = [__file__, given.folder, str(given.edge), given.table, step, f"--limit={given.limit}"]
            rows.append(subprocess.run([sys.executable, *words], check=True, stdout=subprocess.PIPE, text=True).stdout)
        write_rows(given.table, "step,seconds,nanoseconds_a_voxel,largest_memory_mib", [row.strip() for row in rows])
        return
    if given.limit < math.inf:
        # what programs write to: files that are mapped are no part of it, and threads that wait take none
        resource.setrlimit(resource.RLIMIT_DATA, (int(given.limit * 2**30),) * 2)
    warnings.simplefilter("ignore")
    memory = Memory()
    memory.start()
    began, step = time.process_time(), given.steps[0]
    found = STEPS[step](given.folder, given.edge)
    seconds = time.process_time() - began
    each = seconds / given.edge**3 * 1e9
    sys.stdout.write(f"{step},{seconds:.0f},{each:.0f},{memory.most}\n")
    sys.stderr.write(f"{step}: {found}\n")


if __name__ == "__main__":
    main()
