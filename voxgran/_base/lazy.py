"""Third-party libraries, imported on first use, with a remedy when they cannot be.

This is also the one place that sets what must be set before such a library is loaded: VTK's window class on a
machine without a display, and numba's threading layer (open3d loads a TBB that numba refuses with a warning).

Importing, and compiling or loading kernels, is done once in a process: *preparation*, whose time is counted for those
who compare the seconds of runs.
"""

import contextlib
import importlib
import os
import re
import resource
import sys
import time
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from voxgran._base.errors import MissingLibraryError
from voxgran._base.stopping import heed

if TYPE_CHECKING:
    from xarray import DataArray as DataArray
    from xarray import Dataset as Dataset
    from xarray import DataTree as DataTree
else:
    # names in annotations, for which the library need not be there
    DataArray = Dataset = DataTree = Any

#: the libraries that a run may load: `plan` predicts them, `run` records them
LIBRARIES = (
    "jinja2",
    "manifold3d",
    "matplotlib",
    "meshio",
    "netCDF4",
    "numba",
    "open3d",
    "plotly",
    "pyvista",
    "rich",
    "scipy",
    "vtkmodules",
    "xarray",
)

#: names by which libraries are known that are imported by another one
_TITLES = {"skimage": "scikit-image"}

#: bytes that some libraries need to be loaded
SHORT = 2**28

_DEBIAN_PACKAGES = {
    "libusb-1.0": "libusb-1.0-0",
    "libGL.": "libgl1",
    "libEGL": "libegl1",
    "libX11": "libx11-6",
    "libgomp": "libgomp1",
    "libXrender": "libxrender1",
}


@dataclass(slots=True)
class Preparation:
    """CPU time of this process that preparation has taken, in seconds."""

    seconds: float = 0.0
    depth: int = 0


_counted: ContextVar[Preparation | None] = ContextVar("counted", default=None)


@contextlib.contextmanager
def counting_preparation() -> Iterator[Preparation]:
    """Count the preparation that happens meanwhile in this thread (context manager)."""
    count = Preparation()
    token = _counted.set(count)
    try:
        yield count
    finally:
        _counted.reset(token)


@contextlib.contextmanager
def preparing() -> Iterator[None]:
    """Count what happens meanwhile as preparation, if anybody asks for it (context manager); it may be nested."""
    count = _counted.get()
    if count is None:
        yield
        return
    began = time.process_time()
    count.depth += 1
    try:
        yield
    finally:
        count.depth -= 1
        if not count.depth:
            count.seconds += time.process_time() - began


def load(name: str) -> Any:
    """Import a library on first use; a signal that has been noted is heeded before.

    Parameters
    ----------
    name : str
        Module to import, such as ``"open3d"`` or ``"scipy.ndimage"``.

    Returns
    -------
    module
        Typed as Any, since several of these libraries carry no types.

    Raises
    ------
    MissingLibraryError
        If it, or a system library under it, cannot be loaded.
    """
    heed()
    root = name.partition(".")[0]
    if root in ("vtkmodules", "pyvista") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        with contextlib.nullcontext() if name in sys.modules else preparing():
            module = importlib.import_module(name)
    except (ImportError, OSError) as error:
        raise MissingLibraryError(f"{root} cannot be loaded ({error}): {_remedy(root, str(error))}") from error
    except ValueError as error:
        # numba reads its environment when it is imported
        raise MissingLibraryError(
            f"{name} cannot be loaded ({error}): correct the variables of the environment, such as NUMBA_NUM_THREADS"
        ) from error
    if name == "numba":
        module.config.THREADING_LAYER = "omp"
    return module


def load_extra(name: str, extra: str, need: str) -> Any:
    """Import a library of an extra of voxgran; `need` says in the message what needs it.

    Raises
    ------
    MissingLibraryError
        If it cannot be loaded; the message has the line that installs the extra.
    """
    try:
        return load(name)
    except MissingLibraryError as error:
        root = name.partition(".")[0]
        raise MissingLibraryError(
            f"{_TITLES.get(root, root)} is not installed: {need}; install it with pip install 'voxgran[{extra}]'"
        ) from error


def loaded() -> tuple[str, ...]:
    """Return which of LIBRARIES this process has loaded."""
    return tuple(name for name in LIBRARIES if isinstance(sys.modules.get(name), ModuleType))


def _is_short_of_memory() -> bool:
    """Return whether this process has hardly any memory left of a limit that it has."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    with contextlib.suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        return limit != resource.RLIM_INFINITY and limit - pages * os.sysconf("SC_PAGE_SIZE") < SHORT
    return False


def _remedy(root: str, message: str) -> str:
    """Say what installs the thing that is missing, or that memory is."""
    if re.search("Cannot allocate memory|failed to map segment", message) or _is_short_of_memory():
        return "there is too little memory; end other programs, or raise the limit (ulimit -v)"
    for library, package in _DEBIAN_PACKAGES.items():
        if library in message:
            return f"install it with 'sudo apt-get install -y {package}'"
    return f"install it with 'pip install {'vtk' if root == 'vtkmodules' else root}'"
