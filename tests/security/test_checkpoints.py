"""Checkpoints with a right hash that no run has written: an error, or a run that ends; never a crash."""

import hashlib
import os
import resource
import signal
import traceback
import warnings

import numpy as np
import pytest
from kit import Forked, slow

import voxgran as vg
from voxgran._base.checkpoint import load_checkpoint, save_checkpoint
from voxgran._base.errors import CheckpointError, Interrupted, VoxgranError
from voxgran.cli import main

pytestmark = pytest.mark.usefixtures("forked_readers")

SPHERE, CUBE = vg.shapes.sphere(), vg.shapes.box(lengths=(1, 1, 1))
ROOM, CELL = vg.Box((4, 4, 4)), vg.Box((4, 4, 4), periodic="xyz")
LATTICE = [(1 + 1.3 * (k % 2), 1 + 1.3 * (k // 2 % 2), 0.8 + 1.2 * (k // 4)) for k in range(8)]
BED = vg.Packing.of([CUBE], ROOM, position=LATTICE, gravity=(0, 0, -1))
LOOSE = vg.Packing.of([SPHERE], CELL, position=[(1.3 * (k % 3), 1.3 * (k // 3 % 3), 2 * (k // 9)) for k in range(18)])


def packed(shape, container, method, **given):
    """Return a call that packs with options of a run."""
    return lambda **run: vg.pack(shape, container, method, **given, **run)


#: kinds of checkpoints: after how many steps a run is stopped, and the run
RUNS = {
    "rsa": (6, packed(SPHERE, ROOM, "rsa", count=25)),
    "rsa, true shapes": (8, packed(CUBE, ROOM, "rsa", count=12)),
    "rsa, scan": (4, packed(SPHERE, ROOM, "rsa", count=8, scheme="2", tries=20)),
    "digital_rsa": (6, packed(SPHERE, ROOM, "digital_rsa", voxel_size=0.25, count=20)),
    "digital": (7, packed(CUBE, ROOM, "digital", count=8, voxel_size=0.2, settle=False)),
    "digital, sleeping": (7, packed(CUBE, ROOM, "digital", count=8, voxel_size=0.2, schedule="sleeping", settle=False)),
    "digital, settled": (15, packed(CUBE, ROOM, "digital", count=8, voxel_size=0.2)),
    "digital_fill": (2, packed(CUBE, ROOM, "digital_fill", count=6, voxel_size=0.2)),
    "control_point": (7, packed(CUBE, ROOM, "control_point", count=6, settle=False)),
    "deposition": (3, packed(SPHERE, vg.Box((4, 4, 20)), "deposition", count=60)),
    "advancing_front": (3, packed(SPHERE, vg.Box((9, 9, 9)), "advancing_front")),
    "expand": (1, packed(SPHERE, CELL, "expand", count=60, solid_fraction=0.5)),
    "expand, true shapes": (3, packed(CUBE, CELL, "expand", count=12, solid_fraction=0.4)),
    "jam": (3, packed(SPHERE, CELL, "jam", count=20)),
    "multilayer": (2, packed(SPHERE, ROOM, "multilayer", count=20)),
    "growth": (4, packed(SPHERE, ROOM, "growth", count=40)),
    "random_apollonian": (3, packed(SPHERE, ROOM, "random_apollonian", count=40)),
    "tetrahedral": (1, packed(SPHERE, ROOM, "tetrahedral", count=20)),
    "tetrahedral, any size": (1, packed(SPHERE, vg.Box((5, 5, 12)), "tetrahedral")),
    "voronoi_fill": (3, packed(SPHERE, ROOM, "voronoi_fill", count=10)),
    "gravity": (20, packed(SPHERE, ROOM, "gravity", count=20)),
    "settle": (20, lambda **run: vg.settle(BED, **run)),
    "settle, solid fraction": (20, lambda **run: vg.settle(BED, solid_fraction=0.5, **run)),
    "gravity, height": (20, packed(SPHERE, vg.Box((4, 4, 12), periodic="xy"), "gravity", height=6.0, fall_height=30.0)),
    "compress": (20, lambda **run: vg.compress(LOOSE, **run)),
    "compress, solid fraction": (20, lambda **run: vg.compress(LOOSE, solid_fraction=0.65, **run)),
}
#: those that are tried at each change, as the quickest of their kind
QUICK = ("rsa", "digital_rsa", "digital", "deposition", "expand")


def run(kind, path, *, steps, **options):
    """Run a kind until it has made some steps; return whether it has ended by itself."""
    left = [steps]

    def step(done):
        # before a run begins, nobody listens to signals
        left[0] -= done.stage != "compiling" and signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        if not left[0]:
            os.kill(os.getpid(), signal.SIGTERM)

    try:
        RUNS[kind][1](checkpoint=path, on_step=step, **options)
    except Interrupted:
        return False
    return True


def replaced(array):
    """Yield arrays that take the place of another: of other shapes and types, and with odd values."""
    yield array[:0] if array.ndim else array.reshape(1)
    yield array[None]
    yield np.array(3).astype(array.dtype)
    yield np.full(array.shape, "x")
    yield array.astype(array.dtype.newbyteorder(">"))
    if array.ndim:
        yield np.concatenate([array, array[-1:] if len(array) else np.zeros((1, *array.shape[1:]), array.dtype)])
    if array.ndim and len(array):
        yield array[:-1]
    if array.dtype.kind not in "iuf" or not array.size:
        return
    odd = (np.nan, np.inf, -1e300, 1e18, -1.0, 0.0) if array.dtype.kind == "f" else (-1, 2**62, -(2**62), 10**6, 0)
    for value in np.array(odd).astype(array.dtype):
        yield np.full_like(array, value)
        one = array.copy()
        one.flat[array.size // 2] = value
        yield one
    yield array.ravel()[::-1].reshape(array.shape)
    yield -array


def hostile(header, arrays):
    """Yield headers and arrays in which one thing was replaced."""
    for name, array in arrays.items():
        yield header, {key: value for key, value in arrays.items() if key != name}
        for other in replaced(array):
            yield header, {**arrays, name: other}
    for name in header["counters"]:
        for value in (-1, 0, 2**62, -(2**62), 10**30, None, "x"):
            yield {**header, "counters": {**header["counters"], name: value}}, arrays
    for name in ("done", "total", "stop_reason", "counters"):
        for value in (-1, 2**62, 10**30, None, "x", [], "count"):
            yield {**header, name: value}, arrays
    yield header, {**arrays, "more": np.zeros(3)}


def try_all(kind, path):
    """Try all that is hostile, and end the process with 0, or with 3 after it has told what else was raised."""
    warnings.simplefilter("ignore")
    # what hangs is ended so
    resource.setrlimit(resource.RLIMIT_CPU, (600, 610))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        run(kind, path, steps=RUNS[kind][0])
        whole = path.read_bytes()
        run(kind, path, steps=2, resume=True)
        path.write_bytes(whole)
        header, arrays = load_checkpoint(path)
        refused = 0
        for changed in hostile(header, arrays):
            save_checkpoint(path, *changed)
            before = path.read_bytes()
            try:
                run(kind, path, steps=3, resume=True)
            except CheckpointError:
                refused += 1
                assert path.read_bytes() == before
            except VoxgranError:
                # a run that has gone on may end so
                pass
        assert refused > 5 * len(arrays)
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
        os._exit(3)
    os._exit(0)


@pytest.mark.parametrize("kind", [kind if kind in QUICK else slow(kind) for kind in RUNS])
def test_a_checkpoint_that_no_run_has_written_is_refused_or_ends(kind, tmp_path):
    assert Forked(lambda: try_all(kind, tmp_path / "c.voxgran")).wait() == 0


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize("kind", RUNS)
def test_what_a_run_leaves_is_not_refused(kind, tmp_path):
    """Also later, where it holds more than at its begin."""
    ended = run(kind, tmp_path / "c.voxgran", steps=RUNS[kind][0])
    for steps in (1, 30, 400, 10**9):
        if not ended:
            ended = run(kind, tmp_path / "c.voxgran", steps=steps, resume=True)
    assert ended


@pytest.mark.parametrize("header", ["[" * 100_000, '{"fingerprint": NaN}', "[[1, 2], [3]]", '"text"', "1e999"])
def test_headers_that_are_none_are_refused(header, tmp_path):
    """The checkpoint of another program, whose hash is right."""
    path = tmp_path / "c"
    save_checkpoint(path, {}, {})
    body = np.frombuffer(header.encode(), dtype=np.uint8)
    np.savez(tmp_path / "a.npz", header=body)
    raw = (tmp_path / "a.npz").read_bytes()
    line = hashlib.sha256(raw).hexdigest()
    path.write_bytes(f"voxgran checkpoint 1 {line} {len(raw)}\n".encode() + raw)
    with pytest.raises(VoxgranError, match="start anew"):
        vg.pack(SPHERE, ROOM, "rsa", count=2, checkpoint=path, resume=True)


def test_the_checkpoint_of_another_run_is_refused(tmp_path, capsys):
    """By each command that goes on: one sentence, exit status 2, and the file stays as it is."""
    vg.save(BED, tmp_path / "bed.vtp")
    vg.save(LOOSE, tmp_path / "loose.vtp")
    vg.save(vg.pack(SPHERE, CELL, "expand", count=40, solid_fraction=0.4), tmp_path / "sample.vtp")
    scene = '[[shape]]\nfamily = "sphere"\n[container]\nkind = "box"\nlengths = [4, 4, 4]\n[packing]\nmethod = "rsa"\n'
    (tmp_path / "scene.toml").write_text(scene + "count = 3\n")
    checkpoint, out = tmp_path / "c.voxgran", tmp_path / "out"
    vg.pack(SPHERE, ROOM, "rsa", count=2, checkpoint=checkpoint)
    out.mkdir()
    for name in ("checkpoint.voxgran", "twin/checkpoint.voxgran"):
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_bytes(checkpoint.read_bytes())
    before = checkpoint.read_bytes()
    for words in (
        ["settle", "bed.vtp", "-o", "a.vtp", "--checkpoint", "c.voxgran"],
        ["compress", "loose.vtp", "-o", "a.vtp", "--checkpoint", "c.voxgran"],
        ["run", "scene.toml", "-o", "out"],
        ["twin", "sample.vtp", "-o", "out/twin", "--count", "20", "--protocol", "expand"],
    ):
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path)
            assert main([*words, "--resume"]) == 2, words
        told = capsys.readouterr().err
        assert "belongs to another run" in told, words
        assert "Traceback" not in told
    for path in (checkpoint, out / "checkpoint.voxgran", out / "twin" / "checkpoint.voxgran"):
        assert path.read_bytes() == before
