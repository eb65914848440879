"""Images in blocks take the memory of blocks: the numbers of docs/guide/scans.md, by the tool that measured them."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("dask.array")
pytest.importorskip("zarr")
pytest.importorskip("skimage")

ROOT = Path(__file__).parents[2]
#: most mebibytes of each step, without what lies in files; measured are 171, 396, 430, 574, 688 and 703. Surfaces of
#: labels are made in windows of at most 1 GiB, of which this image needs one, and one of 64 million voxels smaller ones
MOST = {"image": 250, "components": 450, "distance": 600, "thickness": 800, "segment": 850, "labels": 800}
#: most of them in GiB, beyond which a step fails
LIMIT = 2


@pytest.mark.slow
def test_an_image_of_27_million_voxels_becomes_a_packing(tmp_path):
    command = [sys.executable, ROOT / "tools" / "block_speed.py", tmp_path, "300", *MOST, f"--limit={LIMIT}"]
    environment = {"DASK_NUM_WORKERS": "1", "OPENBLAS_NUM_THREADS": "1"}
    ended = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **environment})
    sys.stdout.write(ended.stdout)
    found = dict(re.findall(r"^(\w+): (.*)$", ended.stdout, re.MULTILINE))
    assert list(found) == list(MOST)
    for step, most in MOST.items():
        assert int(re.search(r"(\d+) MiB", found[step])[1]) < most, found[step]
    grains = {step: int(re.search(r"(\d+) grains", found[step])[1]) for step in ("image", "segment", "labels")}
    assert grains["labels"] == grains["image"]
    assert grains["segment"] == pytest.approx(grains["image"], rel=0.02)
    # the packing has the solid fraction of the one that was painted
    shares = [float(re.search(r"fraction (\d\.\d+)", found[step])[1]) for step in ("image", "labels")]
    assert shares[1] == pytest.approx(shares[0], rel=1e-3)
