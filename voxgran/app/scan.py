"""The pane of a scan: an image is opened, segmented by sliders on three slices, and becomes a packing, as of a run."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from voxgran.app.desk import Desk
from voxgran.app.forms import value_of
from voxgran.report.slices import WORDS
from voxgran.scene.scans import ScanProcess

#: fields of text, and what they mean
FIELDS = {
    "path": "image (.npy, .npz, .tif, .vti, .nrrd, .mha), or a folder of DICOM slices",
    "voxel_size": "edge of a voxel, or [5, 5, 8]; empty: as the file says",
    "unit": "unit of the edges",
    "min_size": "voxels of the smallest grains, bodies and holes",
    "gravity": "where gravity acts in the sample, such as -z; empty: nowhere",
}
#: sliders, and the state that holds their ends
SLIDERS = {"threshold": ("scan_low", "scan_high"), "separation": ("0", "scan_widest")}
#: what is said while the process is busy, and the field beside which an error stands that names none
BUSY = {"open": "reading and segmenting", "segment": "segmenting", "draw": "", "finish": "making the packing"}
BESIDE = {"open": "path", "segment": "threshold", "draw": "threshold", "finish": "gravity"}
#: seconds after which a slider that was moved is taken
PAUSE = 0.6


class ScanPane:
    """The pane, and the process in which the scan is worked on."""

    def __init__(self, desk: Desk, state: Any, shown: Callable[[int], None]) -> None:
        self.desk, self.state, self.shown = desk, state, shown
        self.process, self.asked, self.moved_at = ScanProcess(), [""][:0], 0.0
        self.taken: tuple[Any, ...] = ()
        self.folder: Path | None = None
        begin = dict.fromkeys(("path", "voxel_size", "unit", "min_size", "gravity", "about", "found", "busy"), "")
        begin |= {"low": 0, "high": 1, "threshold": 0, "separation": 0, "proposed": 0, "widest": 1, "dark": False}
        begin |= {"x": 0.5, "y": 0.5, "z": 0.5, "slices": [], "errors": {}, "said": ""}
        state.update({"scanning": False} | {f"scan_{name}": value for name, value in begin.items()})
        state.change(*(f"scan_{name}" for name in ("x", "y", "z", "threshold", "separation", "dark")))(self.moved)

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
        """Let the process do something, once."""
        self.asked = [*(other for other in self.asked if other != name), name]

    def follow(self) -> None:
        """Show what the process has answered, and let it do what is asked for since."""
        name, state = self.process.doing, self.state
        told = self.process.answer()
        if told is not None:
            self._show(name, *told)
        if state.scan_about and self._settings() != self.taken and time.monotonic() > self.moved_at + PAUSE:
            self.ask("segment")
            self.taken = self._settings()
        if self.asked and not self.process.doing:
            self.process.begin(self.asked[0], self._given(self.asked.pop(0)))
        state.scan_busy = BUSY.get(self.process.doing, "")

    def _given(self, name: str) -> dict[str, Any]:
        """Return the arguments of a method of the scan, as the page has them."""
        state, desk = self.state, self.desk
        level, decrease, dark = self._settings()
        texts = {key: str(state[f"scan_{key}"]).strip() for key in FIELDS}
        given = {key: value_of({"text": text, "word": key in ("path", "unit")}) for key, text in texts.items() if text}
        least = {"dark_grains": dark} | {key: given[key] for key in ("min_size",) if key in given}
        if name == "open":
            edges = {key: given.get(key) for key in ("voxel_size", "unit")}
            return {"path": desk.base / given.get("path", ""), **edges, **least}
        if name == "segment":
            # a separation that is not moved stays that of the library, which follows the sizes of grains
            return {"threshold": level, "separation": None if decrease == state.scan_proposed else decrease, **least}
        if name == "draw":
            return {"at": [state[f"scan_{axis}"] for axis in "xyz"], "threshold": level, "dark_grains": dark}
        self.folder = desk.queue.next_folder()
        self.folder.mkdir(parents=True)
        return {"folder": self.folder, "mapping": desk.mapping, "base": desk.base, "gravity": given.get("gravity")}

    def _show(self, name: str, answer: dict[str, Any] | str, said: list[str]) -> None:
        """Show an answer, or the sentence of an error beside its field."""
        state = self.state
        if isinstance(answer, str):
            fields = (word for word in (*FIELDS, *SLIDERS) if answer.startswith(word))
            state.scan_errors = {next(fields, BESIDE[name]): answer}
            if name == "finish" and self.folder is not None:
                shutil.rmtree(self.folder, ignore_errors=True)
        elif name == "finish" and self.folder is not None:
            state.scan_errors, state.scanning = {}, False
            self.shown(self.desk.queue.take(self.folder, answer["scene"], said).number)
        else:
            state.update({"scan_errors": {}} | {f"scan_{key}": value for key, value in answer.items()})
            if name != "draw":
                state.scan_said = " ".join(said)
                # the first separation is that of the library
                state.scan_proposed = answer["separation"] if name == "open" else state.scan_proposed
                self.taken = self._settings()
                self.ask("draw")

    def _settings(self) -> tuple[Any, ...]:
        """Return threshold, separation, and whether grains are dark, as the page has them."""
        return tuple(self.state[f"scan_{name}"] for name in (*SLIDERS, "dark"))

    def build(self, v3: Any, html: Any) -> None:
        """Lay out the pane, which covers the view."""
        bare = {"density": "compact", "hide_details": "auto"}
        main = {"color": "primary", "variant": "flat"}
        over = "position: absolute; inset: 0; z-index: 2; overflow: auto; background: white"
        with html.Div(v_show="scanning", id="scan", classes="pa-4", style=over):
            with v3.VRow(dense=True):
                for name, hint in FIELDS.items():
                    beside = {"error_messages": (f"scan_errors.{name}",), "hint": hint, "persistent_hint": True, **bare}
                    with v3.VCol(cols=12 if name == "path" else 3):
                        v3.VTextField(v_model=(f"scan_{name}",), label=name, id=f"scan-{name}", **beside)
            v3.VBtn("Open", click=self.open, id="scan-open", **main)
            html.Span("{{ scan_about }} {{ scan_busy }}", classes="text-caption mx-4", id="scan-about")
            v3.VProgressLinear(v_if="scan_busy", indeterminate=True)
            with html.Div(v_if="scan_about"):
                for name, (low, high) in SLIDERS.items():
                    limits = {"min": (low,), "max": (high,), "error_messages": (f"scan_errors.{name}",)}
                    label = (f"'{name} ' + Number(scan_{name}.toPrecision(4))",)
                    v3.VSlider(v_model=(f"scan_{name}",), label=label, id=f"scan-{name}", **limits, **bare)
                v3.VCheckbox(v_model=("scan_dark",), label="grains are darker than the void", **bare)
                v3.VBtn("To a packing", click=(self.ask, "['finish']"), id="scan-finish", **main)
                html.Div("{{ scan_found }} {{ scan_said }}", classes="text-body-2", id="scan-found")
                for color, words in WORDS.items():
                    html.Span(f"■ {words} ", style=f"color: {color}", classes="text-caption")
                with v3.VRow(dense=True), v3.VCol(v_for="(slice, k) in scan_slices", key="k"):
                    wide = "`width: 100%; image-rendering: pixelated; aspect-ratio: ${slice.aspect}`"
                    html.Img(src=("slice.source",), style=(wide,), classes="slice")
                with v3.VRow(dense=True):
                    for axis in "xyz":
                        with v3.VCol():
                            place = {"min": 0, "max": 1, "step": 0.005, "label": f"across {axis}"}
                            v3.VSlider(v_model=(f"scan_{axis}",), id=f"scan-{axis}", **place, **bare)
