"""The pane of a scan: an image is opened, segmented by sliders on three slices, and becomes a packing, as of a run."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from voxgran._base.arrays import as_choice, as_number
from voxgran._base.errors import InputError, shown
from voxgran._base.files import made_folder
from voxgran.app.desk import Desk
from voxgran.app.failures import Failures
from voxgran.app.forms import value_of
from voxgran.report.slices import WORDS
from voxgran.scene.scans import DOING, FIELDS, ScanProcess

#: sliders, and the state that holds their ends
SLIDERS = {"threshold": ("scan_low", "scan_high"), "separation": ("0", "scan_widest")}
#: seconds after which a slider that was moved is taken
PAUSE = 0.6


class ScanPane:
    """The pane, and the process in which the scan is worked on."""

    def __init__(self, desk: Desk, state: Any, opened: Callable[[int], None]) -> None:
        self.desk, self.state, self.opened = desk, state, opened
        self.caught = Failures(state).caught
        self.process, self.moved_at = ScanProcess(), 0.0
        self.asked: list[str] = []
        self.folder: Path | None = None  # of a packing that is made
        self.taken: list[Any] = []
        begin: dict[str, Any] = dict.fromkeys((*FIELDS, "about", "found", "busy", "python"), "") | dict.fromkeys(
            "xyz", 0.5
        )
        begin |= {"low": 0, "high": 1, "threshold": 0, "separation": 0, "widest": 1, "dark": False}
        begin |= {"slices": [], "errors": {}, "said": []}
        state.update({"scanning": False} | {f"scan_{name}": value for name, value in begin.items()})
        state.change(*(f"scan_{name}" for name in ("x", "y", "z", "dark", *SLIDERS)))(self.caught(self.moved))

    def open(self, path: Path | None = None) -> None:
        """Open an image, and segment it with the threshold and separation that are proposed."""
        if path is not None:
            self.state.scan_path, self.state.scanning = str(path.resolve()), True
        self.ask("open")

    def moved(self, **_: Any) -> None:
        """Draw what a slider changes; when it rests the image is segmented anew."""
        self.moved_at = time.monotonic()
        if self.state.scan_about:
            self.ask("draw")

    def ask(self, name: str) -> None:
        """Let the process do something, once.

        Raises
        ------
        InputError
            If that is nothing which it does.
        """
        as_choice(name, "what is asked of a scan", tuple(DOING))
        self.asked = [*(other for other in self.asked if other != name), name]

    def stop(self) -> None:
        """Stop what is computed; the image is to be opened again."""
        self.process.stop()
        self.asked.clear()
        self.state.scan_about = ""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)

    def follow(self) -> None:
        """Show what the process has answered, and let it do what is asked for since."""
        name, state = self.process.doing, self.state
        answer = self.process.answer()
        if answer is not None:
            self.folder = None
            self._show(answer)
        now = [state[f"scan_{name}"] for name in ("dark", *SLIDERS)]
        if answer is not None and name in ("open", "segment"):
            self.taken = now
            self.moved()
        elif state.scan_about and now != self.taken and time.monotonic() > self.moved_at + PAUSE:
            self.taken = now
            self.ask("segment")
        if self.asked and not self.process.doing:
            self.process.begin(self.asked[0], self._given(self.asked.pop(0)))
        state.scan_busy = self.process.words

    def _show(self, answer: dict[str, Any]) -> None:
        """Show an answer; a packing is a run that is done."""
        self.state.update({f"scan_{key}": value for key, value in answer.items() if key != "scene"})
        if "scene" in answer:
            self.state.scanning = False
            self.opened(self.desk.queue.take(Path(answer["folder"]), answer["scene"]).number)

    def _given(self, name: str) -> dict[str, Any]:
        """Return what the page says of the scan."""
        state, desk = self.state, self.desk
        texts = {key: state[f"scan_{key}"] for key in FIELDS}
        for key, text in texts.items():
            if not isinstance(text, str):
                raise InputError(f"{key} is {shown(text)}: it must be text; load the page again")
        words = {"path", "unit"}
        given: dict[str, Any] = {key: texts[key].strip() for key in words}
        given |= {key: value_of({"text": text, "word": False}) for key, text in texts.items() if key not in words}
        given = {key: value for key, value in given.items() if value != ""}
        given |= {key: as_number(state[f"scan_{key}"], key) for key in SLIDERS} | {"dark": state["scan_dark"] is True}
        base = Path() if desk.base == Path.cwd() else desk.base  # the lines of Python are for who starts here
        given |= {"path": base / given.get("path", "")}
        given["at"] = [as_number(state[f"scan_{axis}"], axis, at_least=0.0, at_most=1.0) for axis in "xyz"]
        if name == "finish":
            self.folder = made_folder(desk.queue.next_folder())
            given |= {"folder": self.folder, "mapping": desk.mapping, "base": desk.base}
        return given

    def build(self, v3: Any, html: Any) -> None:
        """Lay out the pane, which covers the view."""
        bare, main = {"density": "compact", "hide_details": "auto"}, {"color": "primary", "variant": "flat"}
        left, right, top = (f"var(--v-layout-{side})" for side in ("left", "right", "top"))
        over = f"position: fixed; inset: {top} {right} 0 {left}; z-index: 2; overflow: auto; background: white"
        with html.Div(v_show="scanning", id="scan", classes="pa-4", style=over):
            with v3.VRow(dense=True):
                for name, hint in FIELDS.items():
                    beside = {"error_messages": (f"scan_errors.{name}",), "hint": hint, "persistent_hint": True, **bare}
                    with v3.VCol(cols=12 if name == "path" else 6, lg=12 if name == "path" else 3):
                        v3.VTextField(v_model=(f"scan_{name}",), label=name, id=f"scan-{name}", **beside)
            v3.VBtn("Open", click=self.caught(lambda: self.open()), id="scan-open", classes="my-2", **main)
            html.Span("{{ scan_about }} {{ scan_busy }}", classes="text-caption mx-4", id="scan-about")
            v3.VBtn("Stop", v_if="scan_busy", click=self.caught(self.stop), id="scan-stop", size="x-small")
            v3.VProgressLinear(v_if="scan_busy", indeterminate=True)
            with html.Div(v_if="scan_about"):
                for name, (low, high) in SLIDERS.items():
                    limits = {"min": (low,), "max": (high,), "error_messages": (f"scan_errors.{name}",)}
                    limits["step"] = (f"{high} - {low} > 50 ? 1 : 0",)
                    label = (f"'{name} ' + Number(scan_{name}.toPrecision(4))",)
                    v3.VSlider(v_model=(f"scan_{name}",), label=label, id=f"scan-{name}", **limits, **bare)
                v3.VCheckbox(v_model=("scan_dark",), label="grains are darker than the void", **bare)
                v3.VBtn("To a packing", click=(self.caught(self.ask), "['finish']"), id="scan-finish", **main)
                html.Div("{{ scan_found }}", classes="text-body-2 mt-2", id="scan-found")
                html.Div("{{ text }}", v_for="text in scan_said", classes="text-caption text-warning")
                with v3.VRow(dense=True):
                    for k, axis in enumerate("xyz"):
                        with v3.VCol(v_if=(one := f"scan_slices[{k}]")):
                            look = f"`width: 100%; image-rendering: pixelated; aspect-ratio: ${{{one}.aspect}}`"
                            html.Img(src=(f"{one}.source",), style=(look,), classes="slice")
                            place = {"min": 0, "max": 1, "step": 0.005, "label": axis}
                            v3.VSlider(v_model=(f"scan_{axis}",), id=f"scan-{axis}", **place, **bare)
                for color, words in WORDS.items():
                    html.Span(f"■ {words} ", style=f"color: {color}", classes="text-caption")
                html.Pre("{{ scan_python }}", style="font: 11px monospace; white-space: pre-wrap", id="scan-python")
