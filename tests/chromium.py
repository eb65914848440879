"""Headless Chromium for the tests of pages, driven over its debugging pipe, without a driver or a library."""

import base64
import io
import json
import os
import select
import shutil
import subprocess
import time

import numpy as np
from PIL import Image

PROGRAM = shutil.which("chromium") or shutil.which("google-chrome")
#: WebGL on the processor, which needs no graphics card; root needs --no-sandbox
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--enable-unsafe-swiftshader",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--remote-debugging-pipe",
]
#: seconds that a page may take to answer
PATIENCE = 120.0


class Page:
    """One page of a browser: what it was asked for, what it complained of, its picture."""

    def __init__(self, folder):
        down, up = os.pipe(), os.pipe()
        # the browser reads commands from descriptor 3 and writes answers to 4
        line = f'exec "$0" "$@" 3<&{down[0]} 4>&{up[1]}'
        self.process = subprocess.Popen(
            ["bash", "-c", line, PROGRAM, *FLAGS, f"--user-data-dir={folder}", "about:blank"],
            pass_fds=(down[0], up[1]),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(down[0])
        os.close(up[1])
        self.write, self.read, self.rest, self.number = down[1], up[0], b"", 0
        self.events, self.session = [], None
        target = next(t for t in self.ask("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.ask("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self.session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session = None
        try:
            self.ask("Browser.close")
            self.process.wait(20)
        except (OSError, TimeoutError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
        os.close(self.write)
        os.close(self.read)

    def ask(self, method, **parameters):
        """Return the answer to a command; events that come first are kept."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.write, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + PATIENCE
        while True:
            answer = self._next(end - time.monotonic(), method)
            if answer.get("id") == self.number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self.events.append(answer)

    def _next(self, seconds, method):
        """Return the next message of the browser."""
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.read], [], [], max(seconds, 0.0))
            if not ready:
                raise TimeoutError(f"no answer to {method} in {PATIENCE:g} s")
            content = os.read(self.read, 1 << 20)
            if not content:
                raise BrokenPipeError(f"the browser ended before it answered {method}")
            self.rest += content
        first, _, self.rest = self.rest.partition(b"\0")
        return json.loads(first)

    def open(self, path, *, width=1200, height=1000, scripts=True):
        """Open a file and wait until it is loaded, and its view if it has one."""
        self.events.clear()
        self.size(width, height)
        self.ask("Emulation.setScriptExecutionDisabled", value=not scripts)
        self.ask("Page.navigate", url=path.resolve().as_uri())
        ended = "document.readyState === 'complete'"
        view = "(!document.getElementById('view') || document.getElementById('view-body').dataset.ready === 'yes')"
        self.wait(f"{ended} && {view}" if scripts else ended)

    def go(self, address):
        """Open an address and wait until it is loaded."""
        self.events.clear()
        self.ask("Page.navigate", url=address)
        self.wait("document.readyState === 'complete'")

    def size(self, width, height=1000):
        """Set the size of the window, in pixels."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def run(self, code):
        """Return the value of an expression in the page."""
        answer = self.ask("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, code, seconds=PATIENCE):
        """Wait until an expression is true."""
        end = time.monotonic() + seconds
        while not self.run(code):
            assert time.monotonic() < end, f"not true after {seconds:g} s: {code}; {self.complaints()}"
            time.sleep(0.05)

    def mouse(self, *events, button="left"):
        """Send events of the mouse: kind and place of each."""
        for kind, x, y in events:
            held = {"button": button, "buttons": 1, "clickCount": 1} if kind != "mouseMoved" or len(events) > 3 else {}
            self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **held)
            self.frames(2)

    def frames(self, count):
        """Wait for frames of the page to be drawn."""
        step = "await new Promise((done) => requestAnimationFrame(done));"
        self.run(f"(async () => {{ {step * count} }})()")

    def box(self, selector):
        """Return left, top, width and height of an element, after scrolling to it."""
        find = f"document.querySelector({json.dumps(selector)})"
        self.run(f"{find}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
        self.frames(2)
        code = f"(() => {{ const b = {find}.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; }})()"
        return self.run(code)

    def picture(self, selector=None):
        """Return what the window shows, or an element of it, as (h, w, 3) bytes."""
        x, y, w, h = (round(value) for value in self.box(selector)) if selector else (0, 0, 0, 0)
        shot = base64.b64decode(self.ask("Page.captureScreenshot")["data"])
        pixels = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))
        return pixels[y : y + h, x : x + w] if selector else pixels

    def complaints(self):
        """Return errors and warnings of the console, exceptions, and failed requests, since the page was opened."""
        found = []
        for event in self.events:
            method, said = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(said["exceptionDetails"])
            elif method == "Runtime.consoleAPICalled" and said["type"] in ("error", "assert"):
                found.append([one.get("value") for one in said["args"]])
            elif method == "Log.entryAdded" and said["entry"]["level"] == "error":
                found.append(said["entry"]["text"])
        return found

    def requests(self):
        """Return the addresses that the page asked for since it was opened."""
        sent = (e["params"]["request"]["url"] for e in self.events if e.get("method") == "Network.requestWillBeSent")
        return [address for address in sent if not address.startswith(("data:", "blob:"))]
