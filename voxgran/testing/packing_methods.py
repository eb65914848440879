"""What every packing method must keep, as a class of tests to derive from."""

from collections.abc import Mapping
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from voxgran._base.errors import GrainTooLargeError, InputError
from voxgran._base.stopping import Stopped, stopping_when
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.packing.draw import Request
from voxgran.packing.driver import Drive, drive
from voxgran.packing.method import RunState, method_registry
from voxgran.packing.missed import Task
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack, prepare_task
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.sizes import lognormal
from voxgran.testing.kill import kill_and_resume

#: interruptions of one run, at most
MOST_STOPS = 40


class PackingMethodSuite:
    """Tests of one packing method; derive from it in a test file and name the method.

    A run of the default scene should take less than a second, since about thirty are made: choose `parameters` so. A
    test that a method cannot pass for a good reason is switched off by ``test_... = None`` in the derived class.

    Attributes
    ----------
    method : str
        Name under which the method is registered.
    parameters : mapping
        Parameters of the method that make runs short; all others have their defaults.
    count : int
        How many grains the default scene has.
    shortened : mapping of str to int
        Constants, such as ``"my_package.cubic.SITES_AT_ONCE"``, that decide how much is done between two calls of
        :func:`~voxgran._base.stopping.stop_if_asked`, with the small values that they get while a run is interrupted
        again and again. No result may depend on them.

    Examples
    --------
    >>> from voxgran.testing import PackingMethodSuite
    >>> class TestRsa(PackingMethodSuite):
    ...     method = "rsa"
    """

    method: ClassVar[str] = ""
    parameters: ClassVar[Mapping[str, Any]] = {}
    count: ClassVar[int] = 10
    shortened: ClassVar[Mapping[str, int]] = {}
    _kept: ClassVar[Packing]

    @classmethod
    def shapes(cls) -> list[Shape]:
        """Return the shapes of the default scene: a box and a sphere."""
        return [make_shape("box", lengths=(1.1, 0.9, 0.7)), make_shape("sphere")]

    @classmethod
    def container(cls) -> Container:
        """Return the container of the default scene: a box, periodic along x."""
        return Box((3.5, 3.5, 4), "x")

    @classmethod
    def request(cls, *, count: int | None = None, seed: int = 1) -> Request:
        """Return the request of the default scene: the numbers given, and lognormal sizes if it takes any."""
        return Request(
            *(cls.shapes(), cls.container(), cls.method),
            count=cls.count if count is None else count,
            sizes=None if cls.makes_sizes() else lognormal(0.8, 0.2),
            seed=seed,
            parameters=dict(cls.parameters),
        )

    @classmethod
    def makes_sizes(cls) -> bool:
        """Return whether the method makes the sizes of the grains."""
        return method_registry().get(cls.method).sizing == "made"

    @classmethod
    def takes_start(cls) -> bool:
        """Return whether the method packs around the grains of a start."""
        return method_registry().get(cls.method).start != "refused"

    @classmethod
    def task(cls, *, count: int | None = None, seed: int = 1) -> Task:
        """Return the default scene, ready to be packed."""
        return prepare_task(cls.request(count=count, seed=seed))

    @classmethod
    def run(cls, *, chunk: int | None = None, seed: int = 1) -> Packing:
        """Return the packing of the default scene, made in chunks of so many attempts."""
        return _packed(cls.task(seed=seed), Drive(chunk=chunk))

    @classmethod
    def packing(cls) -> Packing:
        """Return the packing of the default scene, made once for all tests."""
        if "_kept" not in cls.__dict__:
            cls._kept = cls.run()
        return cls._kept

    def test_true_shapes_do_not_overlap_or_escape(self) -> None:
        """Grains of the default scene overlap neither each other nor a wall."""
        packing = self.packing()
        assert packing.count > 0
        proof = verify(packing)
        assert proof.escaped == 0
        assert proof.ok, proof.summary()

    def test_single_attempts_give_the_same(self) -> None:
        """Chunks of one attempt, over the first 600 only: all of them would take too long."""
        states = []
        for chunk in (1, 600):
            task = self.task()
            state = task.method.prepare(task.problem)
            while state.done < 600 and not state.stop_reason:
                state = task.method.advance(task.problem, state, min(chunk, 600 - state.done))
            states.append(contents_of(state))
        assert states[0] == states[1]

    def test_same_seed_same_bits_other_seed_others(self) -> None:
        """The seed decides the packing, to the last bit, however many attempts are made in one call."""
        assert bits_of(self.run(chunk=7)) == bits_of(self.packing())
        assert bits_of(self.run(seed=2)) != bits_of(self.packing())

    def test_no_grains(self) -> None:
        """A packing of no grains is a packing."""
        packing = pack(self.shapes(), self.container(), method=self.method, count=0, **self.parameters)
        assert packing.count == 0
        assert verify(packing).ok
        assert packing.solid_fraction == 0

    def test_a_grain_larger_than_the_container(self) -> None:
        """Grains of which none fits are refused, and so are any sizes where the method makes them."""
        if self.makes_sizes():
            with pytest.raises(InputError, match="makes the sizes of the grains itself"):
                pack(make_shape("sphere"), self.container(), method=self.method, count=3, sizes=lognormal(0.8, 0.2))
            return
        with pytest.raises(GrainTooLargeError, match="none can fit"):
            pack(make_shape("sphere"), Box((3, 3, 0.5)), method=self.method, count=3, **self.parameters)

    def test_each_row_of_a_list_is_placed_once(self) -> None:
        """Grains of a list have the shapes and sizes of their rows, in whatever order they are placed; methods that
        make or scale sizes refuse a list.
        """
        shape, diameter, count = np.array([0, 1, 1, 0, 1]), np.array([0.5, 0.9, 0.6, 0.8, 0.7]), [1, 1, 3, 1, 2]
        rows = {"shape": shape, "diameter": diameter, "count": count}
        shapes, asked = self.shapes(), {"grains": rows, "seed": 1, **self.parameters}
        method = method_registry().get(self.method)
        if method.sizing != "drawn" and not method.keeps_sizes:
            with pytest.raises(InputError, match="places grains as they are, one of"):
                pack(shapes, self.container(), self.method, **asked)
            return
        packing = pack(shapes, self.container(), self.method, **asked)
        row = packing.grain_id
        assert row is not None
        assert np.bincount(row).tolist() == count
        assert packing.shape_id.tolist() == shape[row].tolist()
        assert packing.diameters == pytest.approx(diameter[row], rel=1e-12)
        assert verify(packing).ok

    def test_tilted_cells_are_packed_or_refused(self) -> None:
        """Grains in a tilted cell do not overlap across its faces; methods for upright containers refuse it."""
        flat = self.container().dimension == 2
        cell = Rectangle((4, 5), "xy", tilt=1.5) if flat else Box((4, 4, 5), "xy", tilt=(1.5, 0, 0))
        asked = {"count": 6, "seed": 1, **self.parameters}
        if not method_registry().get(self.method).tilted:
            with pytest.raises(InputError, match="takes upright containers only"):
                pack(self.shapes(), cell, self.method, **asked)
            return
        packing = pack(self.shapes(), cell, self.method, **asked)
        assert packing.count > 0
        assert verify(packing).ok

    def test_obstacles_stay_where_they_are(self) -> None:
        """No grain overlaps a fixed one, and this stays in its place; methods that move all grains refuse it."""
        container, kind = self.container(), "sphere" if self.container().dimension == 3 else "disk"
        middle = container.bounds.mean(axis=0)
        obstacle = Packing.of(make_shape(kind, diameter=1.5), container, position=[middle])
        # as many as bear a stress around it
        asked = {"count": 8, "seed": 1, "obstacles": obstacle, **self.parameters}
        if method_registry().get(self.method).obstacles == "refused":
            with pytest.raises(InputError, match="packs around obstacles, one of"):
                pack(self.shapes(), container, self.method, **asked)
            return
        packing = pack(self.shapes(), container, self.method, **asked)
        assert packing.fixed is not None
        assert packing.fixed.tolist() == [True, *[False] * (packing.count - 1)]
        assert packing.count > 1
        # a container that is compressed takes its middle along
        assert packing.position[0] == pytest.approx(packing.container.bounds.mean(axis=0), abs=1e-9)
        assert verify(replace(packing, fixed=None)).ok

    def test_periodic_grains_wrap(self) -> None:
        """Nothing is lost at a periodic face: moved by half of each periodic length, the packing is still valid."""
        packing = self.packing()
        (lower, upper), periodic = packing.container.bounds, packing.container.periodic
        moved = Packing.of(
            packing.shapes,
            packing.container,
            position=packing.position + np.where(periodic, (upper - lower) / 2, 0.0),
            scale=packing.scale,
            shape_id=packing.shape_id,
            orientation=packing.orientation,
        )
        assert verify(moved).ok == verify(packing).ok

    def test_no_attempts_change_nothing(self) -> None:
        """A call with no attempts makes what follows from the problem and leaves the state as it is."""
        task = self.task()
        state = task.method.prepare(task.problem)
        before = contents_of(state)
        state = task.method.advance(task.problem, state, 0)
        assert contents_of(state) == before
        assert not state.stop_reason

    def test_stopped_at_any_look_it_goes_on_to_the_same_bits(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """What was begun is lost and nothing else, whether the state is kept in memory or read from a checkpoint."""
        task, again = self.task(), self.task()
        whole = drive(task.method, task.problem, Drive(chunk=200))
        for name, value in self.shortened.items():
            monkeypatch.setattr(name, value)
        state, stops = _often_stopped(again)
        assert contents_of(state) == contents_of(whole)
        self.check_stops(stops)

    def check_stops(self, stops: int) -> None:
        """Check how often the run was interrupted; here any number will do."""

    def test_killed_and_resumed_to_the_same_bits(self, tmp_path: Path) -> None:
        """SIGKILL at random moments, also while a checkpoint is being written, until it comes through."""
        shares = np.random.Generator(np.random.Philox(3)).uniform(0.05, 0.6, 4).tolist()
        again = self.killed_and_resumed(tmp_path / "checkpoint", shares)
        assert bits_of(again) == bits_of(self.packing())
        # what was killed holds no lock, and what came through removed its own
        assert [file.name for file in tmp_path.iterdir()] == ["checkpoint"]

    @classmethod
    def killed_and_resumed(
        cls, checkpoint: Path, shares: list[float], *, count: int | None = None, chunk: int | None = 200
    ) -> Packing:
        """Return the packing of a run that is killed after some shares of its whole time, and then comes through."""
        asked = {"request": cls.request(count=count), "checkpoint": checkpoint, "shares": shares, "chunk": chunk}
        # forked from a process that has loaded the compiler and holds no threads
        context = get_context("forkserver")
        context.set_forkserver_preload(["voxgran.testing.kill", "voxgran._base.compiling.linking"])
        process = context.Process(target=kill_and_resume, kwargs=asked)
        process.start()
        process.join(1200)
        exit_code = process.exitcode
        process.kill()
        assert exit_code == 0, f"a run that was not killed ended with exit code {exit_code}"
        return _packed(cls.task(count=count), Drive(checkpoint=checkpoint, resume=True, chunk=chunk))

    def test_a_start_stays_in_order_and_goes_on(self) -> None:
        """Spheres on a lattice that touch stay and come first; then the method goes on from a packing of its own."""
        ticks = np.arange(3) + 0.5
        lattice = np.array(np.meshgrid(ticks, ticks, ticks[:2])).reshape(3, -1).T
        box = Box((3.5, 3.5, 6), "x")
        foreign = Packing.of([make_shape("sphere", diameter=0.9)], box, position=lattice)
        if not self.takes_start():
            with pytest.raises(InputError, match="leave start out, or give a method that begins with grains, one of"):
                pack([], box, method=self.method, start=foreign, **self.parameters)
            return
        found = pack([], box, method=self.method, start=foreign, seed=3, **self.parameters)
        assert found.count == len(lattice)
        assert found.diameters == pytest.approx(0.9)
        assert verify(found).ok
        again = pack([], box, method=self.method, start=foreign, seed=3, **self.parameters)
        assert bits_of(again) == bits_of(found)
        more = pack(make_shape("cone"), box, method=self.method, start=found, count=2, seed=3, **self.parameters)
        assert more.count == len(lattice) + 2
        assert more.shape_id[-2:].tolist() == [1, 1]
        assert verify(more).ok
        assert more.provenance["asked"]["start"]["count"] == len(lattice)

    def test_a_start_that_has_no_place_is_refused(self) -> None:
        """A start that does not fit, or of another dimension, is refused, by the number of its grain."""
        spheres = Packing.of([make_shape("sphere")], Box((9, 9, 9)), position=[(1, 1, k + 0.5) for k in range(4)])
        words = "grain 3 of start finds no place" if self.takes_start() else "start"
        with pytest.raises(InputError, match=words):
            pack([], Box((1.6, 1.6, 3.95)), method=self.method, start=spheres, **self.parameters)
        flat = Packing.of([make_shape("disk")], Rectangle((9, 9)), position=[(1, 1, 0)])
        with pytest.raises(InputError, match="start has dimension 2"):
            pack([], Box((3, 3, 3)), method=self.method, start=flat, **self.parameters)


def bits_of(packing: Packing) -> bytes:
    """Return the poses, sizes and shapes of all grains as bytes."""
    parts = (packing.position, packing.orientation, packing.scale, packing.shape_id)
    return b"".join(array.tobytes() for array in parts)


def contents_of(state: RunState) -> tuple[Any, ...]:
    """Return all that a checkpoint holds."""
    arrays = {name: (array.dtype, array.shape, array.tobytes()) for name, array in state.arrays.items()}
    return arrays, dict(state.counters), state.done, state.total, state.stop_reason


def _packed(task: Task, how: Drive) -> Packing:
    """Return the packing of a task."""
    return task.method.finish(task.problem, drive(task.method, task.problem, how))


def _often_stopped(task: Task) -> tuple[RunState, int]:
    """Return the last state of a run that was interrupted again and again, and how often it was."""
    looks, stops, wait = 0, 0, 1

    def is_time() -> bool:
        nonlocal looks
        looks += 1
        return stops < MOST_STOPS and looks % wait == 0

    state = task.method.prepare(task.problem)
    while not state.stop_reason:
        before = state.done
        try:
            with stopping_when(is_time):
                state = task.method.advance(task.problem, state, 200)
        except Stopped:
            stops += 1
            if stops % 10 == 0:
                state.derived = {}
        # as long as nothing comes of it, later and later
        wait = wait + 1 if state.done == before else max(1, wait // 2)
    return state, stops
