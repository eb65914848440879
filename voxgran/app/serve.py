"""The server of the app: on the loopback address, for those who have the token."""

import asyncio
import hmac
import logging
import os
import secrets
import signal
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from voxgran._base.files import made_folder, refuse_links
from voxgran._base.lazy import load, load_extra
from voxgran.app.desk import Desk
from voxgran.app.page import Page

log = logging.getLogger(__name__)

#: where the app listens, and the place of its socket
HOST, SOCKET = "127.0.0.1", "/ws"
#: libraries of the extra
LIBRARIES = ("tomli_w", "trame.app", "trame.widgets.vuetify3", "trame_vtk", "trame_pyvista.widgets")


def serve(
    mapping: dict[str, Any],
    folder: Path,
    *,
    base: Path,
    port: int = 0,
    open_browser: bool = True,
    told: Callable[[str], None] | None = None,
) -> None:
    """Serve the app until Ctrl-C.

    Parameters
    ----------
    mapping : dict
        Scene with which it begins.
    folder : Path
        Where runs go.
    base : Path
        Folder in which the files that scenes name are looked for.
    port : int
        Port; 0 takes a free one.
    open_browser : bool
        Whether a browser is opened, where there is one.
    told : callable, optional
        Told the address.

    Raises
    ------
    MissingLibraryError
        If a library of the extra is not installed.
    OutputError
        If the folder cannot be made, or a link in it leads to another place.
    """
    for name in LIBRARIES:
        load_extra(name, "app", "the app needs it")
    refuse_links(made_folder(folder))
    token = secrets.token_urlsafe(16)
    server = load("trame.app").get_server(f"voxgran-{token}", client_type="vue3")
    desk, door = Desk(mapping, folder, base), folder.resolve() / f".voxgran-app-{secrets.token_hex(4)}.html"
    page, tasks = Page(desk, server), list[Any]()

    def ready(**_: Any) -> None:
        address = f"http://{HOST}:{server.port}/?secret={token}"
        if told is not None:
            told(address)
        if open_browser:
            _open(address, door)
        loop = asyncio.get_event_loop()
        tasks.append(loop.create_task(page.watch()))
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            # a terminal that is closed ends the server too
            loop.add_signal_handler(signal.SIGHUP, os.kill, os.getpid(), signal.SIGTERM)

    async def validate(given: Any, client: str) -> bool:
        del client
        return is_secret(given, token)

    def bound(web_server: Any) -> None:
        web_server.app.middlewares.append(guard_of(page, token))
        server.protocol.validateToken = validate

    server.controller.on_server_bind.add(bound)
    server.controller.on_server_ready.once(ready)
    load("trame_server.protocol").CoreServer.authentication_token = token
    server.cli.set_defaults(authKey=token)
    try:
        server.start(port=port, host=HOST, open_browser=False, show_connection_info=False, timeout=0)
    finally:
        door.unlink(missing_ok=True)
        page.thread.shutdown(wait=False, cancel_futures=True)
        desk.queue.close()
        desk.look.stage.close()


def _open(address: str, door: Path) -> None:
    """Open an address in a browser by a file that leads there, for this user only: all users see the command lines of
    programs, and the address has the token.
    """
    try:
        with os.fdopen(os.open(door, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(f'<!DOCTYPE html><meta http-equiv="refresh" content="0;url={address}"><title>voxgran</title>')
        webbrowser.open(door.as_uri())
    except (OSError, webbrowser.Error) as error:
        log.warning("no browser was opened (%s): open the address", error)


def is_secret(given: Any, token: str) -> bool:
    """Return whether a text is the token, after a time that tells nothing of it."""
    return isinstance(given, str) and hmac.compare_digest(given.encode(errors="replace"), token.encode())


def guard_of(page: Page, token: str) -> Any:
    """Return what refuses other hosts and pages without the token, and counts those who look at a page.

    The page is asked for without the token where it is loaded again; then its cookie has it.
    """
    web = load("aiohttp.web")

    async def guard(request: Any, handler: Callable[[Any], Any]) -> Any:
        looks = request.path == SOCKET
        try:
            host, cookie = urlsplit(f"//{request.host}").hostname, f"voxgran-{request.url.port}"
        except ValueError:
            return web.Response(status=400, text="the host is none: open the address that voxgran prints")
        if host not in (HOST, "localhost"):
            return web.Response(status=403, text=f"the app is at {HOST} only")
        if looks and not web.WebSocketResponse().can_prepare(request):
            return web.Response(status=400, text=f"{SOCKET} is for the page: open the address that voxgran prints")
        given, kept = request.query.get("secret"), is_secret(request.cookies.get(cookie), token)
        if looks and not kept:
            # the library prints what it is sent, also by pages of others and before it has asked for the token
            return web.Response(status=403, text="the page has no cookie: open the address that voxgran prints")
        if request.path in ("/", "/index.html"):
            if given is None and kept:
                return web.Response(status=302, headers={"Location": f"/?secret={token}"})
            if not is_secret(given, token):
                return web.Response(
                    status=403, text="the token is missing or wrong: open the address that voxgran prints"
                )
        page.lookers += looks
        try:
            answer = await handler(request)
        finally:
            page.lookers -= looks
        if is_secret(given, token):
            answer.set_cookie(cookie, token, httponly=True, samesite="Strict", path="/")
        return answer

    return web.middleware(guard)
