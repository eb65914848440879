"""The kernel decorator compiles late, links kernels to each other and keeps its cache by content."""

import gc
import hashlib
import os
import resource
import stat
import subprocess
import sys
import tempfile
import time
from functools import partial

import numpy as np
import pytest
from kit import Forked, slow

import voxgran as vg
from voxgran._base.errors import unknown
from voxgran._base.files import is_private
from voxgran._base.kernels import Kernel, cache_folder, inlined_kernel, kernel, telling_of_compilation
from voxgran._base.lazy import load
from voxgran._base.registry import Registry


@kernel
def _double(x):
    return 2.0 * x


@kernel
def _reversed_doubles(values):
    made = np.empty(len(values))
    part = made[1:]
    for k in range(len(values)):
        made[k] = 2.0 * values[len(values) - 1 - k]
    return made if made[0] > part[0] else part


@kernel
def _sum_of_doubles(values):
    total = 0.0
    for value in values:
        total += _double(value)
    return total


def test_kernels_call_kernels():
    assert isinstance(_sum_of_doubles, Kernel)
    assert _sum_of_doubles(np.arange(4.0)) == 12.0
    assert _sum_of_doubles.plain(np.arange(4.0)) == 12.0


@inlined_kernel
def _seventeen_times(x):
    total = 0.0
    for _ in range(17):
        total += x
    return total


@kernel
def _calls_what_is_inlined(x):
    return _seventeen_times(x) + 1.0


def test_inlined_kernels_give_what_others_give():
    assert _calls_what_is_inlined(2.0) == _calls_what_is_inlined.plain(2.0) == 35.0


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("numba.core.codegen", "JITCodeLibrary"),
        pytest.param("numba.core.caching", "CompileResultCacheImpl", marks=pytest.mark.slow),
    ],
)
def test_a_numba_with_other_private_parts_compiles_by_njit(module, name, tmp_path):
    code = f"""
import importlib, warnings
import numba
part = importlib.import_module({module!r})
del part.{name}
import numpy as np
from tests.unit._base.test_kernels import _calls_what_is_inlined, _sum_of_doubles
with warnings.catch_warnings(record=True, action="always") as said:
    assert _sum_of_doubles(np.arange(4.0)) == 12.0
    assert _calls_what_is_inlined(2.0) == 35.0
(line,) = {{str(warning.message) for warning in said}}
assert "{name}" in line and "njit" in line, line
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True, env=environment)
    assert ended.returncode == 0, ended.stderr


def test_decorating_loads_no_numba():
    code = "import sys, voxgran.packing.digital.bit_columns, voxgran._base.seeds; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_cache_folder_can_be_written():
    assert cache_folder().is_dir()
    assert cache_folder() == cache_folder()


def test_unknown_names_get_the_nearest():
    assert unknown("method", "digitl", ["digital", "control_point"]) == (
        "method 'digitl' is unknown: did you mean 'digital'? known are control_point, digital"
    )
    tools = Registry("tool", "voxgran._base", object, group="none").names()
    assert tools[:2] == ("arrays", "axes")
    assert "threads" in tools


def test_a_table_names_the_files_of_entries():
    box = Registry("form", "voxgran.shapes", object, group="none", files={"cuboid": "families.regular.box"})
    assert box.names() == ("cuboid",)
    assert box.get("cuboid").name == "cuboid"


@kernel
def _leaf(x):
    return x * 7.0


@kernel
def _never_calls_it(x):
    n = 1
    for _ in range(3):
        n += 1
    return _leaf(x) if n == 2 else x


@kernel
def _calls_it(x):
    return _leaf(x) + 0.5


@kernel
def _calls_both(x):
    return _never_calls_it(x) + _calls_it(x)


def test_a_callee_is_there_though_its_first_caller_needs_it_no_more():
    assert _calls_both(2.0) == _calls_both.plain(2.0) == 16.5


def hash_of(source, name="outer", **names):
    """Return the hash of a kernel that a text defines."""
    made = dict(names)
    exec(source, {"kernel": kernel, **names}, made)
    return made[name].code_hash


def test_the_hash_follows_all_that_the_code_depends_on():
    outer = "@kernel\ndef outer(x):\n    return inner(x) + STEP\n"
    inner = [Kernel(_leaf.plain), Kernel(_calls_it.plain), Kernel(_leaf.plain, counted=False)]
    hashes = [hash_of(outer, inner=kernel, STEP=1.0) for kernel in inner]
    hashes += [hash_of(outer, inner=inner[0], STEP=value) for value in (2.0, 1, (1.0,), np.ones(2), np.zeros(2))]
    hashes += [hash_of(outer.replace("+", "-"), inner=inner[0], STEP=1.0)]
    assert len(set(hashes)) == len(hashes)
    hashes += [hash_of(outer.replace("STEP", f"STEP * {factor}"), inner=inner[0], STEP=1.0) for factor in (2.0, 3.0)]
    assert len(set(hashes)) == len(hashes)
    # neither its place in a file nor what is written around it matters
    assert hash_of("\n\n" + outer, inner=inner[0], STEP=1.0) == hashes[0]


RUN = """
import logging, sys
logging.basicConfig(stream=sys.stdout, level=logging.INFO, format="%(message)s", force=True)
from voxgran._base.kernels import kernel
@kernel
def half(x):
    return 0.5 * x
print(half(3.0))
"""


class Running(Forked):
    """A process that calls a kernel, and what it prints; it is forked from this one, which has numba loaded."""

    def __init__(self, **environment):
        there, here = os.pipe()

        def call():
            os.environ.update(environment)
            tempfile.tempdir = None
            for found in (cache_folder, load("voxgran._base.compiling.kernel_files")._claims):
                found.cache_clear()
            with os.fdopen(here, "w") as sys.stdout:
                exec(RUN, {"__name__": "__main__"})

        super().__init__(call)
        os.close(here)
        self.stdout = os.fdopen(there)

    def said(self):
        """Return all that it prints, at its end."""
        with self.stdout:
            text = self.stdout.read()
        self.wait()
        assert "1.5" in text
        return text


def run_with(**environment):
    """Return what a process prints that calls a kernel."""
    return Running(**environment).said()


def test_a_kernel_is_compiled_once_per_machine(tmp_path):
    run = partial(run_with, VOXGRAN_CACHE=str(tmp_path))
    first, files = run(), {path.name: path.stat().st_mtime_ns for path in (tmp_path / "kernels").iterdir()}
    assert "compiling" in first
    assert "(once per machine)" in first
    assert "compiling" not in run()
    # a damaged file is compiled again
    for path in (tmp_path / "kernels").iterdir():
        path.write_bytes(b"damaged")
    assert "compiling" in run()
    assert set(files) == {path.name for path in (tmp_path / "kernels").iterdir()}


def test_a_kernel_that_is_kept_loads_nothing_that_only_a_compilation_needs(tmp_path):
    """It makes an array, and the second process neither compiles it nor imports the functions that numba knows."""
    code = (
        "import sys\nimport numpy as np\nfrom tests.unit._base.test_kernels import _reversed_doubles\n"
        "print(_reversed_doubles(np.arange(3.0)), 'numba.np.arraymath' in sys.modules)"
    )
    environment = {**os.environ, "VOXGRAN_CACHE": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    words = {"capture_output": True, "text": True, "check": True, "env": environment}
    first, second = (subprocess.run([sys.executable, "-c", code], **words).stdout.split("]") for _ in range(2))
    assert first[0] == second[0]
    assert first[1].split() == ["True"]
    assert second[1].split() == ["False"]


@kernel
def _winding(values, most):
    """Variables of loops, branches and turns that end early, one of which is assigned on some paths only."""
    total, found = 0.0, np.zeros(len(values))
    for i in range(len(values)):
        row = values[i]
        if row < 0.0:
            sign, size = -1.0, -row
        elif row > most:
            break
        else:
            sign, size = 1.0, row
        for k in range(3):
            part = (size * k, sign)
            if part[0] > most:
                part = (most, part[1])
                total += part[0]
                continue
            for step in range(k):
                last = part[0] + step
                total += last * part[1]
        if size > 1.0 and (sign > 0.0 or size > 2.0):
            extra = size + i
            for k in range(2):
                if found[k % len(found)] > extra:
                    break
                total += k
        while size > 1.0:
            half = 0.5 * size
            size = half
            if half < 0.25:
                return total, found
        if row > 1.0:
            # this branch was taken above, too, which the compiler does not know
            total += extra
        found[i] = size * sign + total
    return total, found


@pytest.mark.parametrize("values", [[], [0.5, -3.0, 2.0], [9.0], [-0.1, 4.0, 9.0, 1.0]], ids=str)
def test_variables_have_the_values_of_plain_functions_on_every_path(values):
    given = np.array(values, dtype=np.float64)
    total, found = _winding(given, 5.0)
    expected, others = _winding.plain(given, 5.0)
    assert total == expected
    assert found.tolist() == others.tolist()


@pytest.mark.parametrize(
    ("uid", "mode", "private"),
    [(0, 0o700, True), (0, 0o755, True), (1, 0o700, False), (0, 0o720, False), (0, 0o702, False)],
)
def test_what_others_own_or_may_write_is_not_private(monkeypatch, uid, mode, private):
    monkeypatch.setattr(os, "getuid", lambda: 0)
    assert is_private(os.stat_result((stat.S_IFREG | mode, 0, 0, 1, uid, 0, 0, 0, 0, 0))) is private


def cache_in(monkeypatch, parent):
    """Return the folder of kernels that another process would find."""
    monkeypatch.setenv("VOXGRAN_CACHE", str(parent))
    monkeypatch.setenv("XDG_CACHE_HOME", str(parent / "other"))
    return cache_folder.__wrapped__()


def test_kernels_that_others_could_have_written_are_not_run(tmp_path, monkeypatch, caplog):
    folder, missed = cache_in(monkeypatch, tmp_path), []
    from voxgran._base.compiling.kernel_files import _Files

    files = _Files(folder, "f", on_miss=partial(missed.append, "missed"), on_save=lambda: None)
    files.save("key", {"a": 1})
    (file,) = folder.iterdir()
    assert (files.load("key"), missed) == ({"a": 1}, [])
    file.chmod(0o666)
    assert (files.load("key"), missed) == (None, ["missed"])
    assert not caplog.records
    folder.chmod(0o777)
    assert cache_in(monkeypatch, tmp_path) == tmp_path / "other" / "voxgran" / "kernels"
    assert f"{folder} belongs to another user, or others may write there" in caplog.text


def first_of(cache, packaged, tmp_path, monkeypatch):
    """Return what is found of two folders that hold a kernel, None for one that does not, and what is compiled."""
    from voxgran._base.compiling import kernel_files

    missed, folders = [], [tmp_path / "cache", tmp_path / "package"]
    monkeypatch.setattr(kernel_files, "PACKAGED", folders[1])
    for folder, content in zip(folders, (cache, packaged), strict=True):
        folder.mkdir()
        if content is not None:
            kernel_files._Files(folder, "f", on_miss=list, on_save=list).save("key", content)
    # neither owned nor written by this user, as where root has installed the package
    (tmp_path / "package").chmod(0o577)
    for path in folders[1].iterdir():
        path.chmod(0o466)
    files = kernel_files._Files(folders[0], "f", on_miss=partial(missed.append, "compiled"), on_save=list)
    return files.load("key"), missed, files


@pytest.mark.parametrize(
    ("cache", "packaged", "found"), [("a", "b", "a"), (None, "b", "b"), ("a", None, "a"), (None, None, None)]
)
def test_kernels_are_looked_for_in_the_cache_then_in_the_package(cache, packaged, found, tmp_path, monkeypatch):
    loaded, missed, _ = first_of(cache, packaged, tmp_path, monkeypatch)
    assert (loaded, missed) == (found, ["compiled"] * (found is None))


def test_kernels_of_the_package_serve_where_versions_are_equal_and_files_whole(tmp_path, monkeypatch):
    from voxgran._base.compiling import kernel_files

    _, missed, files = first_of(None, "b", tmp_path, monkeypatch)
    with monkeypatch.context() as other:
        other.setattr(kernel_files, "VERSIONS", kernel_files.VERSIONS + ".1")
        assert (files.load("key"), missed) == (None, ["compiled"])
    assert (files.load("other types"), len(missed)) == (None, 2)
    assert (files.load("key"), len(missed)) == ("b", 2)
    (path,) = (tmp_path / "package").iterdir()
    path.chmod(0o666)
    path.write_bytes(path.read_bytes()[:-5])
    assert (files.load("key"), len(missed)) == (None, 3)
    files.save("key", "c")
    assert (files.load("key"), len(missed)) == ("c", 3)


TARGET = """
from numba.core.registry import cpu_target
from voxgran._base.compiling.linking import codegen_of
print(*codegen_of(cpu_target.target_context).magic_tuple()[1:])
"""


@pytest.mark.parametrize(
    ("environment", "target"),
    [
        ({}, "x86-64-v3"),
        ({"NUMBA_CPU_NAME": "generic"}, "generic"),
        ({"NUMBA_CPU_FEATURES": "+avx2,+fma"}, "+avx2,+fma"),
    ],
)
def test_kernels_are_compiled_for_the_baseline_where_the_processor_has_it(environment, target):
    from numba.core.codegen import get_host_cpu_features

    from voxgran._base.compiling.linking import FEATURES

    if not environment and not set(get_host_cpu_features().split(",")) >= FEATURES:
        pytest.skip("this processor lacks a part of x86-64-v3")
    words = {"capture_output": True, "text": True, "check": True, "env": {**os.environ, **environment}}
    assert subprocess.run([sys.executable, "-c", TARGET], **words).stdout.split()[-1] == target


def bits_of(what):
    """Return the hash of the voxels of a solid, or of a bed of some grains."""
    if what == "solid":
        held = [vg.voxelize(vg.make_shape("solid_union"), voxel_size=0.03).taken.words]
    else:
        bed = vg.pack(vg.make_shape(what), vg.Box((4, 4, 8), periodic="xy"), "gravity", count=60, seed=1)
        held = [bed.position, bed.orientation]
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in held)).hexdigest()


@pytest.mark.parametrize(
    "what", ["solid", *(pytest.param(grain, marks=pytest.mark.slow) for grain in ("sphere", "convex_polyhedron"))]
)
def test_the_baseline_gives_the_bits_of_this_processor(what, tmp_path):
    import llvmlite.binding

    other = {"NUMBA_CPU_NAME": llvmlite.binding.get_host_cpu_name(), "VOXGRAN_CACHE": str(tmp_path)}
    code = f"from tests.unit._base.test_kernels import bits_of; print(bits_of({what!r}))"
    environment = {**os.environ, **other, "PYTHONPATH": os.pathsep.join(sys.path)}
    words = {"stdout": subprocess.PIPE, "text": True, "env": environment}
    assert subprocess.run([sys.executable, "-c", code], check=True, **words).stdout.strip() == bits_of(what)
    assert list((tmp_path / "kernels").glob("*.kernel"))


def test_a_kernel_that_another_process_compiles_is_waited_for(tmp_path):
    both = [Running(VOXGRAN_CACHE=str(tmp_path)) for _ in range(2)]
    assert sum("compiling" in process.said() for process in both) == 1


def test_only_forgotten_files_of_the_cache_are_removed(tmp_path, monkeypatch):
    hashes = f"{'0' * 16}-{'a' * 16}.kernel"
    from voxgran._base.compiling.kernel_files import MARK

    names = {f"f-{hashes}": MARK, f".{'0' * 16}.draft": MARK, f"g-{hashes}": b"thesis", "thesis.kernel": MARK}
    names |= {".thesis.draft": MARK, "notes.txt": MARK, "../kernels-thesis/results": b"thesis"}
    folder = tmp_path / "kernels"
    (folder / f"h-{hashes}").mkdir(parents=True)
    (tmp_path / "kernels-thesis").mkdir()
    for name, content in names.items():
        (folder / name).write_bytes(content)
    before = set(tmp_path.rglob("*"))
    assert cache_in(monkeypatch, tmp_path) == folder
    assert set(tmp_path.rglob("*")) == before
    for path in before:
        os.utime(path, (0, 0))
    cache_in(monkeypatch, tmp_path)
    assert before - set(tmp_path.rglob("*")) == {folder / name for name in list(names)[:2]}


def test_homes_that_cannot_be_written(tmp_path):
    # nobody makes a folder in a file, not even root, who may write everywhere
    (tmp_path / "home").touch()
    places = dict.fromkeys(("VOXGRAN_CACHE", "XDG_CACHE_HOME", "HOME"), str(tmp_path / "home"))
    assert "compiling" in run_with(**places, TMPDIR=str(tmp_path))
    assert "compiling" not in run_with(**places, TMPDIR=str(tmp_path))
    (folder,) = tmp_path.glob("voxgran-*")
    assert sorted(path.suffix for path in folder.iterdir()) == ["", ".kernel"]
    # what others could have written is not run
    folder.chmod(0o777)
    assert "compiling" in run_with(**places, TMPDIR=str(tmp_path))


def test_progress_tells_that_kernels_are_compiled():
    # no other run has compiled it
    steps, outer, number = [], [], time.time()

    @kernel
    def new(x):
        return x + number

    both = telling_of_compilation(lambda: outer.append("begins"), lambda: outer.append("ends"))
    with both, telling_of_compilation(lambda: steps.append("compiling")):
        new.compiled()._cache._cache_file.load("no such types")
        assert (steps, outer) == (["compiling"], ["begins"])
        new(1.0)
    assert steps == ["compiling"] * 2
    assert outer == ["begins", "begins", "ends"]


@pytest.mark.parametrize("collects", [True, False])
def test_no_garbage_is_looked_for_while_a_kernel_is_compiled(collects, monkeypatch):
    @kernel
    def new(x):
        return x + 3.0

    meanwhile = []
    # it is asked for once the compilation has begun
    monkeypatch.setattr(new.compiled()._cache._cache_file, "load", lambda key: meanwhile.append(gc.isenabled()))
    before = gc.isenabled()
    (gc.enable if collects else gc.disable)()
    assert new(2.0) == 5.0
    after = gc.isenabled()
    (gc.enable if before else gc.disable)()
    assert (meanwhile, after) == ([False], collects)


def test_arrays_of_kernels_are_freed():
    """Kernels are optimized once, without the passes of numba that bring reference counts together."""
    values = np.arange(500.0)
    _reversed_doubles(values)
    before, held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, sys.getrefcount(values)
    for _ in range(100_000):
        _reversed_doubles(values)
    # KiB; arrays that stay would take 400,000
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000
    assert sys.getrefcount(values) == held


#: first calls, and how many kernels each loads or compiles at the most
FIRST_CALLS = [
    ('vg.pack(vg.shapes.sphere(), vg.Box((8, 8, 8)), "rsa", solid_fraction=0.3)', 8),
    ('vg.pack(vg.shapes.sphere(), vg.Box((6, 6, 9)), "gravity", count=30)', 19),
    slow('vg.pack(vg.make_shape("solid_union"), vg.Box((6, 6, 9)), "gravity", count=10)', 24),
    slow('demo.packed("digital", 12)', 37),
    slow('demo.packed("control_point", 12)', 38),
]
COUNTED = """
import gc
import voxgran as vg
from voxgran._base.kernels import Kernel
from voxgran.scene import demo
{}
used = [kernel for kernel in gc.get_objects() if isinstance(kernel, Kernel) and kernel._compiled is not None]
print(sum(len(getattr(kernel.compiled(), "signatures", ())) for kernel in used))
"""


@pytest.mark.parametrize(("call", "most"), FIRST_CALLS)
def test_a_first_call_needs_few_kernels(call, most):
    """They are what a new machine waits for."""
    program = [sys.executable, "-W", "ignore", "-c", COUNTED.format(call)]
    told = subprocess.run(program, capture_output=True, text=True, check=True)
    assert 0 < int(told.stdout) <= most
