"""The page of the app: forms on the left, the scene in the middle, plan, runs and results on the right."""

import asyncio
import contextlib
from pathlib import Path
from typing import Any

from voxgran._base.errors import VoxgranError
from voxgran._base.lazy import load
from voxgran.app.desk import Desk
from voxgran.app.forms import spread
from voxgran.app.look import colors_of, numbers_of
from voxgran.app.scan import ScanPane
from voxgran.decks.engine import engines
from voxgran.io.vtk_files import load_packing
from voxgran.shapes.images.image_files import READERS

#: seconds between two looks at the runs
TICK = 0.5
#: how often a picture is sent again: images are encoded in a thread, and the first that is sent may be the one before
PUSHES = 3


#: what all fields of forms have
FIELD: dict[str, Any] = {
    "v_model": "field.text",
    "label": ("field.name + (field.unit ? ' (' + field.unit + ')' : '')",),
    "placeholder": ("field.default",),
    "persistent_placeholder": True,
    "hint": ("[field.meaning, field.type, field.pasted ? 'a column can be pasted' : ''].filter((s) => s).join('; ')",),
    "persistent_hint": True,
    "density": "compact",
    "id": ("form.name + '-' + field.name",),
    "update_modelValue": "flushState('forms')",
}
#: place of an event of the mouse, in shares of the element that it belongs to
PLACE = "[$event.offsetX / $event.target.clientWidth, $event.offsetY / $event.target.clientHeight]"


#: takes a file away, if there is one
TAKE = (
    "trigger('download', [{file}]).then("
    "(content) => content && utils.download({file}, content, 'application/octet-stream'))"
)


class Page:
    """The page of a desk; all that it knows of a scene comes from the desk."""

    def __init__(self, desk: Desk, server: Any) -> None:
        self.desk, self.server, self.state = desk, server, server.state
        self.state.update(
            {
                "trame__title": "voxgran",
                "forms": desk.forms,
                "plan": "",
                "details": "",
                "errors": {},
                "error": "",
                "runs": [],
                "shown": 0,
                "colors": colors_of(None),
                "color_by": "diameter",
                "forces": False,
                "cut_x": 1,
                "cut_y": 1,
                "cut_z": 1,
                "results": [],
                "lamps": [],
                "python": "",
                "curve": "",
                "held": "",
                "warnings": [],
                "grain": [],
                "upload": None,
                "uploaded": "",
                "engines": list(engines()),
            }
        )
        self.state.change("forms")(self.edited)
        self.state.change("upload")(self.take)
        self.state.change("color_by", "forces")(self.redraw)
        self.state.change("cut_x", "cut_y", "cut_z")(self.cut)
        self.scan = ScanPane(desk, self.state, self.show)
        self.view: Any = None
        self.grown, self.pushes = (0, 0), 0
        self._build()
        self._examine()

    def edited(self, **_: Any) -> None:
        """Take the forms as they stand in the browser; a section of another kind gets its own fields.

        The forms themselves are sent back only where their fields change, since a person goes on typing.
        """
        before = [form["kind"] for form in self.desk.forms]
        self.desk.forms = [dict(form) for form in self.state.forms]
        changed = [*map(spread, self.desk.forms), [form["kind"] for form in self.desk.forms] != before]
        if changed[-1]:
            self.desk.refresh()
        if any(changed):
            self._send_forms()
        self._examine()

    def _send_forms(self) -> None:
        """Send the forms to the browser."""
        self.state.forms = self.desk.forms
        self.state.dirty("forms")

    def _examine(self) -> None:
        """Plan the scene of the forms."""
        self.desk.examine()
        state = self.state
        state.plan, state.details, state.errors = self.desk.plan, self.desk.details, self.desk.errors
        state.error, state.python, state.curve = self.desk.error, self.desk.python(), self.desk.curve
        state.held, empty, self.desk.empty = self.desk.held, self.desk.empty, None
        if empty is not None:
            self.desk.look.show(empty)
            self._update()

    def add_shape(self) -> None:
        """Add a shape."""
        self.desk.add_shape()
        self._send_forms()
        self._examine()

    def remove(self, index: int) -> None:
        """Remove a shape, but the only one."""
        self._guarded(lambda: self.desk.remove(index))
        self._send_forms()
        self._examine()

    def take(self, **_: Any) -> None:
        """Take an uploaded file as one more shape, or as the image of a scan."""
        given = self.state.upload
        file = given[0] if isinstance(given, list) and given else given
        if not file:
            return
        self.state.uploaded, self.state.upload = "", None

        def read() -> None:
            if Path(file["name"]).suffix.lower() in READERS:
                self.scan.open(self.desk.kept(file["name"], bytes(file["content"])))
                return
            self.state.uploaded = self.desk.upload(file["name"], bytes(file["content"]))
            self._send_forms()
            self._examine()

        self._guarded(read)

    def pick(self, across: float, down: float) -> None:
        """Show the numbers of the grain at a place of the picture, in shares of its width and height."""
        look = self.desk.look
        grain = look.grain_at(across, down)
        told = {} if grain is None or look.packing is None else numbers_of(look.packing, grain)
        self.state.grain = [f"{name}: {text}" for name, text in told.items()]

    def preview(self) -> None:
        """Show shapes of the scene."""
        self._guarded(lambda: self.desk.look.show_shapes(self.desk.preview()))

    def run(self) -> None:
        """Queue the scene."""
        self._guarded(self.desk.run)
        self._tell_runs()

    def stop(self, number: int) -> None:
        """Stop a run."""
        self._guarded(lambda: self.desk.queue.stop(self.desk.run_of(number)))

    def go_on(self, number: int) -> None:
        """Let a run go on from its checkpoint."""
        self._guarded(lambda: self.desk.queue.go_on(self.desk.run_of(number)))

    def show(self, number: int) -> None:
        """Show the packing of a run."""
        self._guarded(lambda: self.desk.open(number))
        self.state.shown, self.state.colors = number, colors_of(self.desk.look.packing)
        if self.state.color_by not in self.state.colors:
            self.state.color_by = "diameter"
        self.state.results, self.state.lamps = self.desk.results, self.desk.lamps
        self.state.warnings, self.state.grain = self.desk.warnings, []
        self.redraw()

    def redraw(self, **_: Any) -> None:
        """Draw the packing again."""
        look = self.desk.look
        if look.packing is not None:
            self._guarded(lambda: look.show(look.packing, color_by=self.state.color_by, forces=self.state.forces))
            self.cut()

    def cut(self, **_: Any) -> None:
        """Cut the packing."""
        self.desk.look.cut((float(self.state.cut_x), float(self.state.cut_y), float(self.state.cut_z)))
        self._update()

    def download(self, what: str) -> bytes | None:
        """Return a file of the run that is shown, or of the scene; None where there is none, which the page says."""
        made: list[bytes] = []
        self._guarded(lambda: made.append(self.desk.file(what)))
        return made[0] if made else None

    async def watch(self) -> None:
        """Follow the runs as long as the app is there."""
        while True:
            for run in self.desk.queue.poll():
                if run.state == "done":
                    self.show(run.number)
            self._grow()
            self.scan.follow()
            if self.pushes and self.view is not None:
                self.pushes -= 1
                self.view.update()
            self._tell_runs()
            self.state.flush()
            await asyncio.sleep(TICK / 10 if self.scan.process.doing else TICK)

    def _grow(self) -> None:
        """Show the grains of the run that is computed, where they were written since."""
        run = self.desk.queue.current
        if run is None or (run.number, run.grown) == self.grown or not run.grown:
            return
        self.grown = (run.number, run.grown)
        with contextlib.suppress(VoxgranError):
            self.desk.look.show_growing(load_packing(run.growing))
            self._update()

    def _guarded(self, call: Any) -> None:
        """Call a function; the sentence of an error goes to the page."""
        try:
            self.state.error = ""
            call()
        except VoxgranError as error:
            self.state.error = str(error)
        self._update()

    def _update(self) -> None:
        """Send the picture anew."""
        if self.view is not None:
            self.view.update()
            self.pushes = PUSHES

    def _tell_runs(self) -> None:
        """Say how the runs are."""
        told = [run.told() for run in self.desk.queue.runs]
        if told != self.state.runs:
            self.state.runs = told

    def _build(self) -> None:
        """Lay out the page."""
        v3, html = load("trame.widgets.vuetify3"), load("trame.widgets.html")
        with load("trame.ui.vuetify3").VAppLayout(self.server, theme="light") as layout:
            with v3.VAppBar(density="compact", elevation=1):
                v3.VAppBarTitle("voxgran")
                html.Span("{{ error }}", classes="text-error mx-4", id="error")
                v3.VBtn("CT", click="scanning = !scanning", id="ct")
                v3.VBtn("Preview shapes", click=self.preview, id="preview")
                v3.VBtn("Run", click=self.run, id="run", color="primary", variant="flat", classes="mx-2")
            with v3.VNavigationDrawer(model_value=True, width=340, permanent=True):
                self._forms(v3, html)
            with v3.VNavigationDrawer(model_value=True, width=300, permanent=True, location="right"):
                self._results(v3, html)
            with v3.VMain(), v3.VContainer(fluid=True, classes="pa-0 d-flex flex-column", style="height: 100%"):
                self.scan.build(v3, html)
                self._tools(v3)
                with html.Div(style="flex: 1; min-height: 0", id="view", dblclick=(self.pick, PLACE)):
                    self.view = load("trame_pyvista.widgets").PyVistaRemoteView(self.desk.look.stage)
        layout.root.style = "overflow: hidden"

    def _forms(self, v3: Any, html: Any) -> None:
        """Lay out the forms, one panel for each section."""
        with v3.VExpansionPanels(multiple=True, variant="accordion"):
            with v3.VExpansionPanel(v_for="(form, index) in forms", key="index"):
                with v3.VExpansionPanelTitle():
                    html.Span("{{ form.title }}", classes="font-weight-medium")
                    html.Span("{{ form.on ? form.kind : 'off' }}", classes="text-medium-emphasis mx-2")
                    html.Span("{{ errors[index] }}", classes="text-error text-caption section-error")
                with v3.VExpansionPanelText():
                    v3.VSwitch(
                        v_if="!form.needed && form.name != 'shape'",
                        v_model="form.on",
                        label="used",
                        density="compact",
                        color="primary",
                        update_modelValue="flushState('forms')",
                    )
                    v3.VSelect(
                        v_if="form.kinds.length",
                        v_model="form.kind",
                        items=("form.kinds",),
                        density="compact",
                        label=("form.title",),
                        update_modelValue="flushState('forms')",
                    )
                    with html.Template(v_for="(field, k) in form.fields", key="k"):
                        v3.VSelect(v_if="field.choices.length", items=("['', ...field.choices]",), **FIELD)
                        v3.VTextarea(v_else_if="field.long", rows=1, auto_grow=True, **FIELD)
                        v3.VTextField(v_else=True, **FIELD)
                    with html.Template(v_if="form.name == 'sizes' && curve"):
                        html.Div(v_html="curve", id="curve")
                        html.Pre("{{ held }}", style="font: 11px monospace; white-space: pre-wrap", id="held")
                    v3.VBtn("Remove", v_if="form.number > 0", click=(self.remove, "[index]"), size="small")
        v3.VBtn("Add a shape", click=self.add_shape, variant="text", id="add-shape")
        v3.VFileInput(
            v_model=("upload",),
            label="mesh file, learned shapes (.nc), or scan",
            density="compact",
            classes="mx-4",
            id="upload",
        )
        html.Pre("{{ uploaded }}", classes="text-caption px-4", style="white-space: pre-wrap", id="uploaded")

    def _results(self, v3: Any, html: Any) -> None:
        """Lay out plan, runs, numbers and files."""
        with v3.VCard(title="Plan", variant="flat", density="compact"):
            html.Pre("{{ plan }}", classes="text-caption px-4", style="white-space: pre-wrap", id="plan")
            with v3.VExpansionPanels(variant="accordion"), v3.VExpansionPanel(title="All of the plan"):
                with v3.VExpansionPanelText():
                    html.Pre("{{ details }}", classes="text-caption", style="white-space: pre-wrap", id="details")
        with v3.VCard(title="Runs", variant="flat", density="compact"):
            with html.Div(v_for="run in runs", key="run.number", classes="px-4 py-1 run"):
                html.Span("{{ run.number }}: {{ run.state }} {{ run.error }}")
                html.Span("{{ run.stage }} {{ run.text }}", v_if="run.state == 'running'")
                html.Div("{{ text }}", v_for="text in run.warnings", classes="text-caption text-warning")
                html.Span("{{ run.left === null ? '' : ', about ' + run.left + ' s left' }}")
                v3.VProgressLinear(v_if="run.state == 'running'", model_value=("run.percent",), color="primary")
                v3.VBtn(
                    "Stop",
                    v_if="run.state == 'running' || run.state == 'waiting'",
                    size="x-small",
                    click=(self.stop, "[run.number]"),
                    classes="stop",
                )
                v3.VBtn(
                    "Go on",
                    v_if="run.state == 'stopped' || run.state == 'failed'",
                    size="x-small",
                    click=(self.go_on, "[run.number]"),
                    classes="go-on",
                )
                v3.VBtn("Show", v_if="run.state == 'done'", size="x-small", click=(self.show, "[run.number]"))
        with v3.VCard(title="Results", variant="flat", density="compact", v_if="shown"):
            with html.Div(v_for="lamp in lamps", key="lamp.name", classes="px-4 lamp"):
                v3.VIcon("mdi-circle", color=("lamp.ok ? 'success' : 'error'",), size="small")
                html.Span(" {{ lamp.name }}: {{ lamp.text }}", classes="text-caption")
            with html.Div(v_for="result in results", key="result.name", classes="px-4 text-caption"):
                html.Span("{{ result.name }}: {{ result.text }}")
            html.Div("{{ text }}", v_for="text in warnings", classes="px-4 text-caption text-warning")
            html.Div("{{ text }}", v_for="text in grain", classes="px-4 text-caption grain")
            for name, file in Desk.FILES.items():
                take = TAKE.format(file=f"'{file}'")
                v3.VBtn(name, size="small", variant="outlined", classes="ma-1", click=take, id=f"take-{file}")
            html.Div("Input of engines, with the material of the scene", classes="px-4 text-caption")
            v3.VBtn(
                "{{ engine }}",
                v_for="engine in engines",
                size="x-small",
                variant="text",
                click=TAKE.format(file="engine + '.zip'"),
                id=("'take-' + engine",),
            )
        with v3.VCard(title="The same in Python", variant="flat", density="compact"):
            html.Pre("{{ python }}", classes="text-caption px-4", style="white-space: pre-wrap", id="python")
        self.server.controller.trigger("download")(self.download)

    def _tools(self, v3: Any) -> None:
        """Lay out what turns the view: colours, forces, cuts."""
        bare = {"density": "compact", "hide_details": True}
        share = {"min": 0, "max": 1, "step": 0.01, "classes": "mx-2"}
        with v3.VRow(dense=True, no_gutters=True, classes="px-2 align-center", style="flex: 0"):
            v3.VSelect(v_model=("color_by",), items=("colors",), label="colour by", id="color-by", **bare)
            v3.VCheckbox(v_model=("forces",), label="forces", **bare)
            for axis in "xyz":
                v3.VSlider(v_model=(f"cut_{axis}",), label=axis, id=f"cut-{axis}", **share, **bare)
