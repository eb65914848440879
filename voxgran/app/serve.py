"""The server of the app: on the loopback address, for those who have the token."""

import asyncio
import secrets
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from voxgran._base.lazy import load, load_extra
from voxgran.app.desk import Desk
from voxgran.app.page import Page

#: where the app listens
HOST = "127.0.0.1"
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
    """
    for name in LIBRARIES:
        load_extra(name, "app", "the app needs it")
    folder.mkdir(parents=True, exist_ok=True)
    token = secrets.token_urlsafe(16)
    server = load("trame.app").get_server(f"voxgran-{token}", client_type="vue3")
    desk = Desk(mapping, folder, base)
    page = Page(desk, server)

    def ready(**_: Any) -> None:
        address = f"http://{HOST}:{server.port}/?secret={token}"
        if told is not None:
            told(address)
        if open_browser:
            webbrowser.open(address)
        asyncio.get_event_loop().create_task(page.watch())

    server.controller.on_server_bind.add(lambda bound: bound.app.middlewares.append(guard_of(page, token)))
    server.controller.on_server_ready.once(ready)
    load("trame_server.protocol").CoreServer.authentication_token = token
    server.cli.set_defaults(authKey=token)
    try:
        server.start(port=port, host=HOST, open_browser=False, show_connection_info=False, timeout=0)
    finally:
        page.thread.shutdown(wait=False, cancel_futures=True)
        desk.queue.close()
        desk.look.stage.close()


def guard_of(page: Page, token: str) -> Any:
    """Return what refuses other hosts and pages without the token, and counts those who look at a page.

    The page is asked for without the token where it is loaded again; then its cookie has it.
    """
    web = load("aiohttp.web")

    async def guard(request: Any, handler: Callable[[Any], Any]) -> Any:
        if urlsplit(f"//{request.host}").hostname not in (HOST, "localhost"):
            return web.Response(status=403, text=f"the host is {request.host}: the app is at {HOST} only")
        cookie = f"voxgran-{request.url.port}"
        if request.path in ("/", "/index.html"):
            if "secret" not in request.query and request.cookies.get(cookie) == token:
                return web.Response(status=302, headers={"Location": f"/?secret={token}"})
            if request.query.get("secret") != token:
                return web.Response(
                    status=403, text="the token is missing or wrong: open the address that voxgran prints"
                )
        looks = request.headers.get("Upgrade", "").lower() == "websocket"
        page.lookers += looks
        try:
            answer = await handler(request)
        finally:
            page.lookers -= looks
        if request.query.get("secret") == token:
            answer.set_cookie(cookie, token, httponly=True, samesite="Strict")
        return answer

    return web.middleware(guard)
