"""A measure of another package that notes where it ran and does as its orders say: wait, fail, or end its process."""

import pytest

from voxgran.study import engine
from voxgran.study.runs import SceneCache, compute

MEASURE = """
import json, os, pathlib, signal, time
from voxgran.measures.model import Measure, dataset, variable


def compute(packing):
    # the module may have been imported for an earlier test
    PLACE = pathlib.Path(os.environ["VOXGRAN_MARKS"])
    seed = packing.provenance["seed"]
    orders = json.loads((PLACE / "orders.json").read_text())
    begun = PLACE / str(seed)
    times = len(begun.read_text().split()) if begun.exists() else 0
    with begun.open("a") as file:
        file.write(f"{os.getpid()} ")
    if "watch" in orders:
        found = sorted(pathlib.Path(orders["watch"]).glob("*.voxgran"))
        with (PLACE / "stamps").open("a") as file:
            file.write(" ".join(str(path.stat().st_mtime_ns) for path in found) + "\\n")
    time.sleep(orders.get("wait", 0))
    if times < orders.get("kill", {}).get(str(seed), 0):
        os.kill(os.getpid(), signal.SIGKILL)
    if seed in orders.get("fail", []):
        raise RuntimeError("a fault\\nof two lines")
    return {"/": dataset({"mark": variable((), 10.0 * seed, "m", "mark of the seed")})}


registration = Measure(name="mark", summary="a mark", groups=("/",), compute=compute)
"""


class Marks:
    """What the measure has noted, and what it is to do."""

    def __init__(self, place):
        self.place = place / "begun"
        self.place.mkdir()
        self.order()

    def order(self, **orders):
        import json

        (self.place / "orders.json").write_text(json.dumps(orders))

    def begun(self):
        """Return the processes that each seed was begun in."""
        found = (path for path in self.place.iterdir() if path.name.isdecimal())
        return {int(path.name): [int(number) for number in path.read_text().split()] for path in found}


@pytest.fixture
def marks(tmp_path_factory, monkeypatch):
    """Install the measure ``mark``, also for the processes of a study."""
    place = tmp_path_factory.mktemp("package")
    (place / "marking.py").write_text(MEASURE)
    info = place / "marking-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: marking\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[voxgran.measures]\nmark = marking:registration\n")
    monkeypatch.syspath_prepend(place)
    monkeypatch.setenv("VOXGRAN_MARKS", str(place / "begun"))
    return Marks(place)


class Here:
    """Computes runs in this process; starting others takes longer than all else in most tests of a study."""

    running, compiling, loading, under_way = 0, False, False, ()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def results(self, runs):
        """Yield each run with its record."""
        cache = SceneCache()
        for run in runs:
            yield run, compute(run, cache), b""


@pytest.fixture
def here(monkeypatch):
    """Compute the runs of studies in this process."""
    monkeypatch.setattr(engine, "_executor", lambda options, runs: Here())


@pytest.fixture
def base():
    """Return a small scene, with the measure ``mark``."""
    return {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [4, 4, 4]},
        "packing": {"method": "rsa", "count": 5},
        "measure": {"which": ["density", "mark"]},
    }
