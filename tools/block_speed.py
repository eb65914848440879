"""Measure time and memory of images in blocks: block_speed.py FOLDER EDGE [STEP ...]

The image has EDGE voxels along each axis and shows a packing of spheres of about 34 voxels, which touch. It is painted
by blocks and kept in FOLDER as zarr, where each step opens it in a process of its own. A line for each step: processor
seconds, nanoseconds of them for each voxel, the largest memory of the process, and what was found. Steps: image,
components, distance, thickness, segment, labels; default: all of them, in this order.
"""

import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import voxgran as vg

VOXEL, BLOCK = 1 / 34, 128


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
    sharp = (opened.values > 0).astype(np.float32)
    grey = sharp.map_overlap(gaussian_filter, depth=4, boundary="reflect", sigma=1.0)
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


def main() -> None:
    """Run a step, or each in a process of its own."""
    folder, edge, *steps = sys.argv[1:]
    if len(steps) != 1:
        for step in steps or STEPS:
            subprocess.run([sys.executable, __file__, folder, edge, step], check=True)
        return
    warnings.simplefilter("ignore")
    began = time.process_time()
    found = STEPS[steps[0]](Path(folder), int(edge))
    seconds, peak = time.process_time() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    each = seconds / int(edge) ** 3 * 1e9
    sys.stdout.write(f"{steps[0]}: {seconds:.0f} s, {each:.0f} ns a voxel, {peak:.0f} MiB; {found}\n")


if __name__ == "__main__":
    main()
