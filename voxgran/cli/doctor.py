"""Doctor: what this machine has, what is missing and what mends it, and kernels compiled beforehand."""

import argparse
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import voxgran
from voxgran._base.errors import MissingLibraryError
from voxgran._base.kernels import cache_folder, telling_of_compilation
from voxgran._base.lazy import LIBRARIES, load
from voxgran._base.machine import memory_limit, processor_count
from voxgran._base.stopping import undone_at_end
from voxgran.cli.terminal import progress, show

#: name of the distribution where it is not that of the module
DISTRIBUTIONS = {"vtkmodules": "vtk"}
#: extras of those who work on voxgran, and the one that holds all others
NOT_LISTED = ("all", "dev", "docs")
#: seconds after which a picture counts as not drawn
PATIENCE = 120
#: free space in bytes below which results may not fit
LITTLE_SPACE = 2**30

#: draws a sphere; in a process of its own, since a broken driver ends the process
PICTURE = """
from voxgran._base.lazy import load
pyvista = load("pyvista")
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere(), color="red")
plotter.render()
picture = plotter.screenshot(return_img=True)
print(type(plotter.render_window).__name__, int(picture.max()) - int(picture.min()))
"""


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found of one thing: its name and value, whether it is as it should be, and if not, what mends it."""

    name: str
    value: str
    good: bool = True
    remedy: str = ""


def doctor(options: argparse.Namespace) -> int:
    """Say what this machine has and how to mend what is missing, or compile kernels beforehand."""
    if options.warm:
        return _warm(options)
    with telling_of_compilation(_say_once()):
        findings = list(examine())
    good = all(finding.good for finding in findings)
    if options.json:
        rows = {finding.name: asdict(finding) for finding in findings}
        show({"voxgran": voxgran.__version__, "findings": rows, "all_good": good}, options)
        return 0 if good else 1
    print(f"{'voxgran':16} {voxgran.__version__}")
    for finding in findings:
        print(f"{finding.name:16} {finding.value}" + ("" if finding.good else f"   <- {finding.remedy}"))
    without = [finding.name for finding in findings if finding.name.startswith("[") and "lacks" in finding.value]
    fine = "all good" + (f", without the extras {' '.join(without)}" if without else "")
    print(fine if good else "what is marked <- needs mending")
    return 0 if good else 1


def _say_once() -> Callable[[], None]:
    """Return what says, when it is called first, that kernels are compiled."""
    said: list[bool] = []

    def say() -> None:
        if not said:
            print("compiling the kernels of ten small jobs (once per machine): about a minute", file=sys.stderr)
            said.append(True)

    return say


def _warm(options: argparse.Namespace) -> int:
    """Compile the kernels of usual scenes, and say how many there were."""
    from voxgran.cli.warm import warm

    if not options.json:
        long = "some minutes" if options.warm == "all" else "about two minutes"
        print(f"compiling kernels (once per machine), which may take {long}", file=sys.stderr)
    with progress(options) as on_step:
        done = warm(on_step, options.warm)
    if options.json:
        show({**asdict(done), "kernel_cache": cache_folder()}, options)
    elif done.kernels:
        print(f"{done.kernels} kernels compiled in {done.seconds:.0f} s; they are kept in {cache_folder()}")
    else:
        scenes = "usual scenes" if options.warm == "all" else "the demo"
        print(f"nothing was left to compile ({done.seconds:.0f} s): all kernels of {scenes} are in {cache_folder()}")
    return 0


def examine() -> Iterator[Finding]:
    """Look at libraries, extras, pictures, bits of results, threads, memory and disk, one finding each."""
    floors = _floors()
    for name in ("numpy", *LIBRARIES):
        yield _library(name, floors)
    yield from _extras()
    yield _picture()
    yield _same_bits()
    yield Finding("threads", f"{processor_count()} of {os.cpu_count()} processors may be used")
    free = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES")
    yield Finding("memory", f"{memory_limit() / 2**30:.1f} GiB, {free / 2**30:.1f} GiB of it free")
    yield _disk("disk here", Path.cwd())
    yield _disk("kernel cache", cache_folder())


def _same_bits() -> Finding:
    """Compute ten small jobs, and compare their bits with those of other machines."""
    from voxgran.cli.bits import REFERENCE, differing, other_versions

    differ, of = differing(), f"of {len(REFERENCE)} small jobs"
    if not differ:
        return Finding("bits", f"the results {of} are those of all x86-64-v3 processors")
    value = f"the results of {len(differ)} {of} differ from the reference: {', '.join(differ)}"
    if others := other_versions():
        versions = ", ".join(f"{name} {version}" for name, version in others.items())
        return Finding("bits", f"{value} (made with other versions than {versions})")
    remedy = "this processor, or this C library, computes otherwise: results differ from those of other machines"
    return Finding("bits", value, good=False, remedy=remedy)


def _requirements() -> list[str]:
    """Return what voxgran needs, one distribution a line; nothing where it is run from its source tree."""
    try:
        return importlib.metadata.requires("voxgran") or []
    except importlib.metadata.PackageNotFoundError:
        return []


def _floors() -> dict[str, str]:
    """Return the lowest version that each distribution must have."""
    found = {}
    for line in _requirements():
        if match := re.match(r"([A-Za-z0-9_.-]+)\s*>=\s*([0-9.]+)", line):
            found[match[1].lower()] = match[2]
    return found


def _library(name: str, floors: dict[str, str]) -> Finding:
    """Load a library and compare its version."""
    distribution = DISTRIBUTIONS.get(name, name)
    try:
        load(name)
        version = importlib.metadata.version(distribution)
    except (MissingLibraryError, importlib.metadata.PackageNotFoundError) as error:
        return Finding(distribution, "missing", good=False, remedy=str(error))
    floor = floors.get(distribution.lower(), "0")
    if _numbers(version) < _numbers(floor):
        remedy = f"at least {floor} is needed: pip install -U '{distribution}>={floor}'"
        return Finding(distribution, version, good=False, remedy=remedy)
    return Finding(distribution, version)


def _extras() -> Iterator[Finding]:
    """Look, without loading them, which libraries of each extra are there; none of them has to be."""
    found: dict[str, list[str]] = {}
    for line in _requirements():
        if (match := re.match(r"([\w.-]+).*;\s*extra == ['\"](\w+)['\"]", line)) and match[2] not in NOT_LISTED:
            found.setdefault(match[2], []).append(match[1])
    there = {str(one.metadata["Name"]).lower().replace("_", "-") for one in importlib.metadata.distributions()}
    for extra, names in sorted(found.items()):
        lacking = [name for name in names if name.lower().replace("_", "-") not in there]
        told = f"lacks {', '.join(lacking)}: pip install 'voxgran[{extra}]'" if lacking else "installed"
        yield Finding(f"[{extra}]", told)


def _numbers(version: str) -> tuple[int, ...]:
    """Return the leading numbers of a version."""
    return tuple(int(part) for part in re.findall(r"\d+", version.split("+")[0])[:3])


def _picture() -> Finding:
    """Draw a small picture off screen."""
    remedy = "install Mesa's drivers: sudo apt-get install -y libgl1 libegl1 libgl1-mesa-dri"
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-P", "-c", PICTURE], stdout=pipe, stderr=pipe, text=True) as drawn:
        try:
            with undone_at_end(drawn.kill):
                words = drawn.communicate(timeout=PATIENCE)[0].split()
        except subprocess.TimeoutExpired:
            drawn.kill()
            return Finding("pictures", f"none after {PATIENCE} s", good=False, remedy=remedy)
    if drawn.returncode or len(words) != 2:
        return Finding("pictures", f"cannot be drawn (exit status {drawn.returncode})", good=False, remedy=remedy)
    if words[1] == "0":
        return Finding("pictures", f"blank, by {words[0]}", good=False, remedy=remedy)
    return Finding("pictures", f"drawn off screen by {words[0]}")


def _disk(name: str, folder: Path) -> Finding:
    """Look whether a folder, or the nearest one above that is there, can be written and has room."""
    place = folder
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    value = f"{folder}, {free / 2**30:.1f} GiB free"
    if not os.access(place, os.W_OK):
        remedy = "it cannot be written: change its permissions or go elsewhere"
        if name == "kernel cache":
            remedy = "it cannot be written: name another folder in VOXGRAN_CACHE"
        return Finding(name, value, good=False, remedy=remedy)
    if free < LITTLE_SPACE:
        return Finding(name, value, good=False, remedy="little is left: free space")
    return Finding(name, value)
