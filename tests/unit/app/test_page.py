"""The page of the app without a browser: it answers while it computes, draws for those who look, and keeps nothing."""

import asyncio
import gc
import os
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.app import look, runs
from voxgran.app.desk import Desk
from voxgran.app.look import Look

trame = pytest.importorskip("trame.app", reason="the extra [app] is not installed")
pytest.importorskip("trame_pyvista.widgets")
pytest.importorskip("tomli_w")
web = pytest.importorskip("aiohttp.web")
testing = pytest.importorskip("aiohttp.test_utils")
from voxgran.app.page import Page  # noqa: E402
from voxgran.app.serve import guard_of  # noqa: E402

SPHERES = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 3},
}
#: a run that copies a packing, and its process imports nothing more
COPY = """
import shutil
def serve(channel):
    folder, base, _ = channel.receive()
    folder.mkdir()
    channel.send(("step", "packing", 1, 2, ""))
    shutil.copy(base / "packing.vtp", folder / "packing.vtp")
    channel.send("")
"""


class View:
    """A view that draws, and notes of each picture whether it is smooth."""

    def __init__(self, stage):
        self.stage, self.pictures = stage, []

    def update(self):
        self.pictures.append(self.stage.renderer.GetPass() is not None)
        self.stage.render_window.Render()


@pytest.fixture
def page(tmp_path):
    """Return a page of a desk with spheres."""
    made = Page(Desk(SPHERES, tmp_path / "runs", tmp_path), trame.get_server(str(tmp_path), client_type="vue3"))
    made.desk.look.stage.window_size = (120, 90)
    made.view = View(made.desk.look.stage)
    yield made
    made.thread.shutdown()
    made.desk.queue.close()
    made.desk.look.stage.close()


async def settled(page, until=lambda: True):
    """Watch until something is true and nothing is computed or to be drawn."""
    task = asyncio.ensure_future(page.watch())
    # the first task of the thread ends after those before it
    while not until() or await asyncio.get_running_loop().run_in_executor(page.thread, lambda: False):
        await asyncio.sleep(0.05)
    await asyncio.sleep(0.3)
    task.cancel()


def test_the_page_answers_while_it_computes_and_says_what_went_wrong(page):
    answered, told = threading.Event(), []

    async def act():
        page._worked(lambda: answered.wait(60), told.append)
        # on the loop this would come too late
        await asyncio.sleep(0)
        answered.set()
        await settled(page)
        assert told == [True]

        def wrong():
            raise InputError("count is 0: take more")

        page._worked(wrong, told.append)
        await settled(page)
        assert page.state.error == "count is 0: take more"
        assert told == [True]

    asyncio.run(act())


def test_nothing_is_drawn_for_nobody_and_of_many_changes_one_picture_and_a_smooth_one(page, monkeypatch):
    monkeypatch.setattr(look, "SMOOTHING", "ssaa")
    monkeypatch.setattr("voxgran.app.page.STILL", 0.0)
    monkeypatch.setattr("voxgran.app.page.SLOW", 60.0)
    page.desk.look.show(vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=3, seed=1))

    async def act():
        for share in np.linspace(0.2, 0.8, 7):
            page.state.cut_x = share
            page.cut()
        await settled(page)
        assert page.view.pictures == []
        page.lookers = 1
        await settled(page, lambda: len(page.view.pictures) > 1)
        assert page.view.pictures == [False, True]
        # as when it is turned in the browser
        page.desk.look.stage.camera.Azimuth(20)
        await settled(page, lambda: len(page.view.pictures) > 2)
        assert page.view.pictures == [False, True, True]
        page.desk.shown, page.desk.packing = page.desk.run(), page.desk.look.packing
        assert page.desk.file("picture.png").startswith(b"\x89PNG")
        assert page.desk.look.stage.renderer.GetPass() is None

    asyncio.run(act())


def test_a_picked_grain_is_measured_and_drawn_alone_in_the_thread(page, monkeypatch):
    where, bed = [], vg.pack(vg.shapes.box(), vg.Box((4, 4, 4)), "rsa", count=3, seed=1)
    page.desk.look.show(bed)
    monkeypatch.setattr(Look, "grain_at", lambda *_: 1)
    for name in ("numbers_of_grain", "fit_clump"):
        module = "voxgran.app.page" if name == "numbers_of_grain" else "voxgran.report.scenes"
        call = getattr(sys.modules[module], name)
        noted = lambda *a, call=call, **k: (where.append(threading.current_thread()), call(*a, **k))[1]  # noqa: E731
        monkeypatch.setattr(f"{module}.{name}", noted)

    async def act():
        page.pick(0.5, 0.5)
        await settled(page, lambda: page.state.grain)
        page.state.way = "picked grain: clump"
        page.redraw()
        await settled(page, lambda: len(page.desk.look.stage.actors) and len(where) > 1)

    asyncio.run(act())
    assert page.state.grain[0]["value"] == "1"
    assert "picked grain: clump" in page.state.ways
    assert len(where) == 2
    assert threading.main_thread() not in where
    low, high = np.reshape(page.desk.look.stage.bounds, (3, 2)).T
    assert ((low < bed.position[1]) & (bed.position[1] < high)).all()
    assert (high - low).max() < 3


def test_of_edits_in_a_row_the_last_is_planned(page, monkeypatch):
    planned, free = [], threading.Event()
    monkeypatch.setattr(page.desk, "examine", lambda: planned.append(page.desk.forms))

    async def act():
        page._worked(lambda: free.wait(60), lambda _: None)
        for _ in range(5):
            page.edited()
        free.set()
        await settled(page)

    asyncio.run(act())
    assert len(planned) == 1
    assert planned[0] is page.desk.forms


def test_a_growing_bed_is_drawn_in_a_small_share_of_the_time(page, monkeypatch):
    run = page.desk.run()
    run.state, page.lookers = "running", 1
    monkeypatch.setattr(runs.Queue, "poll", lambda _: [])
    vg.save(vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=3, seed=1), run.growing)
    shown = []
    monkeypatch.setattr(Look, "show", lambda _, packing, **__: (shown.append(packing), time.sleep(0.2)))

    async def act():
        task = asyncio.ensure_future(page.watch())
        for _ in range(20):
            run.grown += 1
            await asyncio.sleep(0.05)
        task.cancel()

    began = time.monotonic()
    asyncio.run(act())
    run.state = "done"
    # each takes 0.2 s
    assert 1 <= len(shown) <= 1 + 0.1 * (time.monotonic() - began) / 0.2


@pytest.mark.slow
def test_a_session_of_200_runs_keeps_nothing(page, tmp_path, monkeypatch):
    vg.save(vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=3, seed=1), tmp_path / "packing.vtp")
    (tmp_path / "copying_run.py").write_text(COPY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(runs, "serve", __import__("copying_run").serve)
    page.lookers = 1

    def kept(count):
        """Return what is there after so many runs."""
        for _ in range(count - len(page.desk.queue.runs)):
            page.run()
        asyncio.run(settled(page, lambda: all(run.state == "done" for run in page.desk.queue.runs)))
        gc.collect()
        kinds = (vg.Packing, pv.PolyData)
        counts = [sum(isinstance(one, kind) for one in gc.get_objects()) for kind in kinds]
        actors, files = len(page.desk.look.stage.actors), len(list(os.scandir("/proc/self/fd")))
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return [*counts, actors, files, threading.active_count()], pages * os.sysconf("SC_PAGE_SIZE") / 2**20

    few, small = kept(20)
    many, large = kept(200)
    assert many == few
    assert large < small + 30
    assert len(page.state.runs) == 200
    assert not any(run.process for run in page.desk.queue.runs)
    assert not list((tmp_path / "runs").glob("*.vtp"))


@pytest.mark.slow
def test_a_picture_of_100000_spheres_takes_about_twice_as_long_as_one_of_a_few_hundred():
    def frame(cells):
        at = np.stack(np.meshgrid(*[np.arange(cells) + 0.5] * 3), axis=-1).reshape(-1, 3)
        look = Look()
        look.stage.disable_anti_aliasing()
        look.show(vg.Packing.of(vg.shapes.sphere(), vg.Box((cells,) * 3), position=at))
        look.stage.render_window.Render()
        began = time.process_time()
        for _ in range(5):
            look.stage.camera.Azimuth(5)
            look.stage.render_window.Render()
        look.stage.close()
        return (time.process_time() - began) / 5

    few, many = frame(7), frame(47)
    assert many < 4 * few, f"343 spheres take {few:.3f} CPU seconds, 103,823 spheres {many:.3f} CPU seconds"


def test_other_hosts_and_pages_without_the_token_are_refused(page):
    async def held(request):
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        async for _ in socket:
            await socket.send_str(str(page.lookers))
        return socket

    async def shown(_):
        return web.Response(text="the page")

    async def act():
        app = web.Application(middlewares=[guard_of(page, "right")])
        app.router.add_get("/index.html", shown)
        app.router.add_get("/ws", held)
        async with testing.TestClient(testing.TestServer(app)) as client:

            async def status(query="", **headers):
                answer = await client.get("/index.html" + query, headers=headers, allow_redirects=False)
                return answer.status

            assert [await status(query) for query in ("", "?secret=wrong", "?secret=")] == [403] * 3
            assert await status("?secret=right", Host="example.org") == 403
            assert await status("?secret=right", Host="127.0.0.1.example.org:80") == 403
            assert await status("?secret=right", Host="localhost:8080") == 200
            client.session.cookie_jar.clear()
            # loaded again without the token
            assert await status("?secret=right") == 200
            assert await status() == 302
            async with client.ws_connect("/ws") as socket:
                await socket.send_str("how many look?")
                assert (await socket.receive()).data == "1"
            while page.lookers:
                await asyncio.sleep(0.01)

    asyncio.run(act())
