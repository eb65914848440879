"""The memory of images in blocks is that of blocks, and not that of the image."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("zarr")
TOOL = Path(__file__).parents[3] / "tools" / "block_speed.py"


@pytest.mark.slow
def test_memory_does_not_grow_with_the_image(tmp_path):
    peaks = []
    for edge in (200, 400):
        words = [str(TOOL), str(tmp_path), str(edge)]
        for steps in (["image"], ["components"], ["labels"]):
            done = subprocess.run([sys.executable, *words, *steps], capture_output=True, text=True, check=True)
            peaks.append(int(re.search(r"(\d+) MiB", done.stdout).group(1)))
            if steps == ["image"]:
                grains = re.search(r"(\d+) grains, solid fraction [.\d]+", done.stdout).group(0)
        assert done.stdout.partition("; ")[2].startswith(grains.partition(",")[0])
    # eight times the voxels; the packing alone takes about 220 kB a grain
    assert peaks[3] < 1.5 * peaks[0]
    assert peaks[4] < 1.5 * peaks[1]
