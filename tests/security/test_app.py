"""The app under what no page of its own sends: names, states, triggers, hosts and disks; it goes on after each."""

import asyncio
import errno
import math
import os
import stat
import time

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, OutputError, VoxgranError
from voxgran.app.desk import Desk, content_of
from voxgran.app.forms import edited
from voxgran.app.runs import Queue

pytest.importorskip("tomli_w")
trame = pytest.importorskip("trame.app", reason="the extra [app] is not installed")
pytest.importorskip("trame_pyvista.widgets")
web = pytest.importorskip("aiohttp.web")
testing = pytest.importorskip("aiohttp.test_utils")
from voxgran.app import serve  # noqa: E402
from voxgran.app.page import Page  # noqa: E402

SPHERES = {
    "shape": [{"family": "sphere"}, {"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 3},
    "measure": {"which": []},
    "output": {"report": False, "vtk": False, "statistics": False},
}
STRANGE = [
    None,
    5,
    -1,
    math.nan,
    1e300,
    "",
    "\0",
    "../../x",
    "/etc/passwd",
    [],
    [5],
    {},
    [{}],
    {"name": 5},
    b"x",
    "x" * 999,
]


@pytest.fixture
def page(tmp_path):
    """Return a page of a desk with two spheres, in a folder with a file that no name leads to."""
    (tmp_path / "secret.toml").write_text("secret")
    made = Page(Desk(SPHERES, tmp_path / "runs", tmp_path), trame.get_server(str(tmp_path), client_type="vue3"))
    made.desk.look.stage.window_size = (120, 90)
    yield made
    made.thread.shutdown()
    made.desk.queue.close()
    made.desk.look.stage.close()


async def watched(page, ticks=3):
    """Watch for some ticks; what works in the thread has ended then."""
    task = asyncio.ensure_future(page.watch())
    for _ in range(ticks):
        await asyncio.get_running_loop().run_in_executor(page.thread, lambda: None)
        await asyncio.sleep(0.12)
    assert not task.done()
    task.cancel()


def works(page):
    """Return whether an edit of the forms is planned."""
    forms = [dict(form) for form in page.desk.forms]
    (packing,) = (form for form in forms if form["name"] == "packing")
    (count,) = (field for field in packing["fields"] if field["name"] == "count")
    count["text"] = "7"
    page.state.forms = forms

    async def edit():
        page.edited()
        await watched(page, 1)

    asyncio.run(edit())
    return "7" in page.desk.plan and not page.state.error


NAMES = [
    "/etc/passwd",
    "../secret.toml",
    "run_1.toml",
    "..",
    "",
    "x.zip",
    "../../x.zip",
    "lammps.zip/../x",
    "\0",
    5,
    None,
]


@pytest.mark.parametrize("name", NAMES)
def test_only_files_of_a_run_are_taken_away(name, page, tmp_path):
    run = page.desk.run()
    run.folder.mkdir()
    vg.save(vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=3, seed=1), run.packing)
    page.desk.open(run.number)
    before = sorted(tmp_path.rglob("*")), sorted(tmp_path.parent.iterdir())
    with pytest.raises(InputError, match=r"there is no file .*: there are packing\.vtp, scene\.toml"):
        page.desk.file(name)
    assert asyncio.run(page.download(name)) is None
    assert "there is no file" in page.state.error
    assert (sorted(tmp_path.rglob("*")), sorted(tmp_path.parent.iterdir())) == before
    assert page.desk.file("packing.vtp")


def test_each_trigger_takes_what_it_takes_only(page, tmp_path):
    asked = page.server.controller._triggers
    assert len(asked) > 10

    async def call():
        for name, call in asked.items():
            for given in (*((one,) for one in STRANGE), *(((), (1, 2, 3)) if name != "download" else ())):
                result = call(*given)
                if name == "download":
                    assert await result is None
        await watched(page)

    asyncio.run(call())
    page.scan.process.stop()
    assert {path.name for path in tmp_path.iterdir()} <= {"runs", "secret.toml"}
    assert [form["name"] for form in page.desk.forms][:3] == ["shape", "shape", "shape"]
    page.desk.forms = Desk(SPHERES, tmp_path / "runs", tmp_path).forms
    assert works(page)


def test_each_field_of_the_state_is_checked(page):
    keys = [key for key in page.state.initial if not key.startswith("trame__")]
    page.state.ready()
    assert {"forms", "upload", "cut_x", "way", "scan_path", "scan_threshold"} <= set(keys)

    async def send():
        for strange in STRANGE:
            before = {key: page.state[key] for key in keys}
            page.state.update(dict.fromkeys(keys, strange))
            page.state.flush()
            page.scan.asked = ["draw"]
            await watched(page, 1)
            page.scan.process.stop()
            page.state.update(before)
            page.state.flush()

    asyncio.run(send())
    assert works(page)


FORMS = [
    None,
    5,
    [],
    [{}],
    "forms",
    lambda forms: forms[1:],
    lambda forms: [{**forms[0], "name": "sizes"}, *forms[1:]],
    lambda forms: [{**forms[0], "kind": "no such family"}, *forms[1:]],
    lambda forms: [{**forms[0], "kind": ["sphere"]}, *forms[1:]],
    lambda forms: [{**forms[0], "on": 1}, *forms[1:]],
    lambda forms: [{**forms[0], "fields": 5}, *forms[1:]],
    lambda forms: [{**forms[0], "fields": [{"name": "label", "text": ["x"]}]}, *forms[1:]],
]


@pytest.mark.parametrize("given", FORMS)
def test_forms_are_those_of_the_scene(given, page):
    before = page.desk.mapping
    sent = given(page.desk.forms) if callable(given) else given
    with pytest.raises(InputError, match="load the page again"):
        edited(page.desk.forms, sent)
    page.state.forms = sent
    page.failures.caught(page.edited)()
    assert "load the page again" in page.state.error
    assert page.desk.mapping == before
    assert works(page)


def test_a_form_gives_kinds_switches_and_texts_only(page):
    sent = [{**form, "title": "x", "kinds": ["x"], "needed": True} for form in page.desk.forms]
    for form in sent:
        form["fields"] = [{**field, "word": not field["word"], "choices": 5} for field in form["fields"]]
    sent[0]["fields"][0]["text"] = None
    taken = edited(page.desk.forms, sent)
    assert taken[1:] == page.desk.forms[1:]
    assert taken[0]["fields"][0] == {**page.desk.forms[0]["fields"][0], "text": ""}


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def full(*_, **__):
    raise FULL


def test_the_app_goes_on_after_errors_of_its_watch(page, monkeypatch, caplog):
    ticks = []
    monkeypatch.setattr(Queue, "poll", lambda _: ticks.append(1) or full())

    async def watch():
        await watched(page)
        assert "No space left on device" in page.state.error
        monkeypatch.setattr(Queue, "poll", lambda _: [])
        monkeypatch.setattr(page.scan, "follow", lambda: [].pop(3))
        await watched(page)
        assert "pop from empty list" in page.state.error
        page.desk.look.stage.render_window.SetSize(0, 0)
        page.lookers = 1
        await watched(page)

    asyncio.run(watch())
    assert len(ticks) > 1
    assert [record.message for record in caplog.records][:2] == ["the app goes on after an error"] * 2
    assert len(caplog.records) < len(ticks) + 5
    page.lookers = 0
    page.desk.look.stage.window_size = (120, 90)
    monkeypatch.undo()
    assert works(page)


def test_a_packing_of_a_scan_on_a_full_disk_is_said(page, monkeypatch):
    page.scan.ask("finish")
    monkeypatch.setattr("pathlib.Path.mkdir", full)
    asyncio.run(watched(page))
    assert "No space left on device" in page.state.error
    monkeypatch.undo()
    page.scan.process.stop()
    assert works(page)
    with pytest.raises(InputError, match="what is asked of a scan is '__class__'"):
        page.scan.ask("__class__")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("x" * 256 + ".stl", "too long for the file system"),
        ("a\0b.stl", "that is no name of a file"),
        *((name, "that is no name") for name in ("..", "", "/", "../../..")),
    ],
)
def test_uploads_have_names_of_files(name, words, page, tmp_path):
    with pytest.raises(InputError, match=words):
        page.desk.upload(name, b"x")
    page.state.upload = {"name": name, "content": b"x"}

    async def take():
        page.failures.caught(page.take)()
        await watched(page, 1)

    asyncio.run(take())
    assert words in page.state.error
    assert not [path for path in tmp_path.rglob("*") if path.is_file() and path.name != "secret.toml"]


@pytest.mark.parametrize("suffix", ["stl", "nc", "npy"])
def test_uploads_on_a_full_disk_say_so(suffix, page, monkeypatch):
    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    with pytest.raises(OutputError, match="No space left on device"):
        page.desk.kept(f"a.{suffix}", b"x")
    page.state.upload = {"name": f"a.{suffix}", "content": b"x"}

    async def take():
        page.failures.caught(page.take)()
        await watched(page, 1)

    asyncio.run(take())
    assert "No space left on device" in page.state.error


def test_an_upload_is_a_name_and_bytes():
    assert content_of({"name": "a", "content": [b"x", b"y"]}) == ("a", b"xy")
    for file in (None, 5, {}, {"name": "a"}, {"name": 5, "content": b""}, {"name": "a", "content": 10**12}):
        with pytest.raises(InputError, match="choose the file again"):
            content_of(file)


def test_requests_that_no_browser_sends_are_refused(page):
    async def shown(_):
        return web.Response(text="the page")

    async def act():
        app = web.Application(middlewares=[serve.guard_of(page, "right")])
        app.router.add_get("/index.html", shown)
        app.router.add_get("/ws", shown)
        async with testing.TestClient(testing.TestServer(app)) as client:

            async def status(path="/index.html", **headers):
                answer = await client.get(path, headers=headers, allow_redirects=False)
                return answer.status

            assert await status("/ws") == 400
            assert await status("/ws?secret=right") == 400
            for host in ("[", "[::1", "127.0.0.1:x", "localhost:99999999"):
                assert await status("/index.html?secret=right", Host=host) in (400, 403), host
            for host in ("[::1]", "127.0.0.1@example.org", "localhost.example.org", ""):
                assert await status("/index.html?secret=right", Host=host) in (400, 403), host
            for secret in ("", "righ", "rightx", "%00", "%C3%A9", "%FF"):
                assert await status(f"/index.html?secret={secret}") == 403
            answer = await client.get("/index.html?secret=right")
            (cookie,) = answer.cookies.values()
            assert (cookie["samesite"], cookie["httponly"], cookie["path"]) == ("Strict", True, "/")
            # a socket is opened by the page only, whose cookie no page of others sends
            asked = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
            asked["Sec-WebSocket-Key"] = "MDEyMzQ1Njc4OWFiY2RlZg=="
            assert await status("/ws", **asked) == 200
            client.session.cookie_jar.clear()
            assert await status("/ws", **asked) == 403
            assert await status("/ws?secret=right", **asked) == 403
            assert await status("/ws", **asked, Cookie=f"{cookie.key}=wrong") == 403

    asyncio.run(act())


def test_the_token_is_compared_as_bytes():
    assert serve.is_secret("right", "right")
    assert not any(serve.is_secret(given, "right") for given in (None, 5, "", "wrong", "righ\xe9", "\udc80", b"right"))


def test_the_token_is_on_no_command_line(tmp_path, monkeypatch):
    opened, door = [], tmp_path / ".door.html"
    monkeypatch.setattr("webbrowser.open", opened.append)
    serve._open("http://127.0.0.1:1/?secret=token", door)
    assert opened == [door.as_uri()]
    assert "secret=token" in door.read_text()
    assert stat.S_IMODE(door.stat().st_mode) == 0o600
    # what lies there is not written to
    serve._open("http://127.0.0.1:1/?secret=other", door)
    assert "secret=other" not in door.read_text()


def test_an_app_lists_the_runs_of_an_earlier_one(tmp_path):
    one = Queue(tmp_path / "runs", tmp_path)
    done, left = one.add(SPHERES), one.add(SPHERES)
    (tmp_path / "runs" / "run_x.toml").write_text("")
    (tmp_path / "runs" / "run_07.toml").write_text("")
    vg.Scene.from_mapping(SPHERES).run(done.folder)
    two = Queue(tmp_path / "runs", tmp_path)
    assert [(run.number, run.folder, run.state) for run in two.runs] == [
        (1, done.folder, "done"), (2, left.folder, "stopped"),
    ]  # fmt: skip
    assert two.add(SPHERES).number == 3
    two.go_on(two.runs[1])
    deadline = time.monotonic() + 120
    while two.runs[1].state in ("waiting", "running") and time.monotonic() < deadline:
        two.poll()
        time.sleep(0.05)
    two.close()
    assert two.runs[1].state == "done", two.runs[1].error
    assert np.array_equal(vg.load(left.packing).position, vg.load(done.packing).position)


def test_a_scene_of_an_earlier_run_that_is_damaged_is_said(tmp_path):
    (tmp_path / "run_1.toml").write_text("[")
    queue = Queue(tmp_path, tmp_path)
    queue.go_on(queue.runs[0])
    deadline = time.monotonic() + 120
    while queue.runs[0].state in ("waiting", "running") and time.monotonic() < deadline:
        queue.poll()
        time.sleep(0.05)
    assert queue.runs[0].state == "failed"
    assert "run_1.toml" in queue.runs[0].error
    assert issubclass(InputError, VoxgranError)


def test_a_view_is_no_larger_than_memory(page):
    window = page.desk.look.stage.render_window
    for size in ((2**31, 5), ((100_000, 100_000),), (-5, 1e9)):
        window.SetSize(*size)
        assert max(window.GetSize()) <= 8192
    for size in (("a", 5), (None, 5), ((1, 2, 3),)):
        with pytest.raises((TypeError, ValueError)):
            window.SetSize(*size)
    window.SetSize(120, 90)
    assert tuple(page.desk.look.stage.window_size) == (120, 90)
