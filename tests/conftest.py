"""What all tests share: how many random examples are tried, and where the scans lie."""

import contextlib
import gc
import importlib
import os
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import settings

import voxgran as vg

pytest_plugins = ["perturb"]

settings.register_profile("fast", max_examples=25, deadline=None)
settings.register_profile("ci", settings.get_profile("fast"), derandomize=True)
settings.register_profile("thorough", max_examples=500, deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "fast")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Search for no garbage while tests are collected, nor later among the many objects that this makes."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter):
    """Name in one line, at the end, the programs and libraries for want of which tests were skipped."""
    from kit import wanted

    yield
    if counts := wanted(report.longrepr[2] for report in terminalreporter.stats.get("skipped", [])):
        told = ", ".join(f"{name} ({count})" for name, count in counts)
        terminalreporter.write_line(f"skipped for want of: {told}")


@pytest.fixture(scope="session")
def data_dir():
    """Return the folder of the scans that the project ships."""
    return Path(__file__).parents[1] / "data"


@pytest.fixture
def jagged_pictures(monkeypatch):
    """Draw pictures of pages small and without smoothing, and figures without ticks and room for labels.

    Nothing looks at them, and all this takes half the time of a report.
    """
    from voxgran.report import stage

    def opened(window, opened=stage.open_stage, **how):
        return opened((300, 300) if tuple(window) in ((900, 900), (600, 600)) else window, **how)

    monkeypatch.setattr(stage, "open_stage", opened)
    monkeypatch.setattr(stage, "SMOOTHING", None)
    monkeypatch.setattr("matplotlib.axis.Axis._update_ticks", lambda self: [])
    monkeypatch.setattr("voxgran.report.plots.fit", lambda axes: None)
    monkeypatch.setattr("matplotlib.layout_engine.ConstrainedLayoutEngine.execute", lambda self, figure: None)


@pytest.fixture
def forked_readers(monkeypatch):
    """Fork the processes that read files from this one, which is quick; the tests that use it look at files only."""
    from kit import forked

    for name in ("meshio", "netCDF4", "nrrd", "pyvista", "tifffile"):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    monkeypatch.setattr("voxgran._base.guarded._process", forked)


@pytest.fixture
def forked_workers(monkeypatch):
    """Fork the processes of studies from this one: each would load its libraries for a second or two."""
    from kit import ForkedWorker

    # what all of them load
    importlib.import_module("voxgran._base.compiling.kernel_files")
    standing = SimpleNamespace(Popen=ForkedWorker, DEVNULL=subprocess.DEVNULL)
    monkeypatch.setattr("voxgran.scene.processes.subprocess", standing)


@pytest.fixture(scope="session")
def eros(data_dir):
    """Return the scan of Eros."""
    return vg.load_shape(data_dir / "eros.obj")
