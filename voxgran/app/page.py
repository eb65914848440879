"""The page of the app: forms on the left, the scene in the middle, plan, runs and results on the right."""

import asyncio
import contextlib
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from voxgran._base.arrays import as_number
from voxgran._base.errors import InputError, VoxgranError
from voxgran._base.lazy import load
from voxgran.app.desk import Desk, content_of
from voxgran.app.failures import Failures
from voxgran.app.forms import edited, spread
from voxgran.app.look import ALONE, GRAINS, MANY, SPHERES, WINDOW
from voxgran.app.runs import REST, Run
from voxgran.app.scan import ScanPane
from voxgran.decks.engine import engines
from voxgran.io.vtk_files import load_packing
from voxgran.packing.model import Packing
from voxgran.report.colors import colors_of
from voxgran.report.facts import Fact
from voxgran.report.scenes import numbers_of_grain
from voxgran.shapes.images.image_files import READERS

#: seconds between two looks at the runs
TICK = 0.1
#: seconds that a picture may take while the view is turned; of rest after which it is smoothed, if it takes fewer than
FRAME, STILL, SLOW = 0.1, 0.4, 1.0

#: texts of a plan
PLANNED = ("plan", "details", "error", "curve", "held")
#: what all of a form have, and its fields
OF_FORM: dict[str, Any] = {"density": "compact", "update_modelValue": "flushState('forms')"}
FIELD: dict[str, Any] = OF_FORM | {
    "v_model": "field.text",
    "label": ("field.name + (field.unit ? ' (' + field.unit + ')' : '')",),
    "placeholder": ("field.default",),
    "persistent_placeholder": True,
    "hint": ("[field.meaning, field.type, field.pasted ? 'a column can be pasted' : ''].filter((s) => s).join('; ')",),
    "persistent_hint": True,
    "error_messages": ("errors[index + '.' + field.name]",),
    "id": ("form.name + '-' + field.name",),
    "classes": "mb-2",
}
UPLOAD = {"density": "compact", "classes": "mx-4", "id": "upload"}
#: place of an event of the mouse, in shares of the element that it belongs to
PLACE = "[$event.offsetX / $event.target.clientWidth, $event.offsetY / $event.target.clientHeight]"

#: how lines of Python are written
CODE = "font: 11px monospace; white-space: pre-wrap"
#: takes a file away, if there is one; its button turns meanwhile, since clumps of many shapes take a while
TAKE = (
    "taking = {file}; trigger('download', [{file}]).then("
    "(content) => {{ taking = ''; content && utils.download({file}, content, 'application/octet-stream') }})"
)


class Page:
    """The page of a desk; all that it knows of a scene comes from the desk."""

    def __init__(self, desk: Desk, server: Any) -> None:
        self.desk, self.server, self.state = desk, server, server.state
        self.failures = Failures(self.state)
        self.caught = self.failures.caught
        texts = (*PLANNED, "python", "uploaded", "large", "taking")
        lists = ("runs", "results", "lamps", "warnings", "grain", "figures")
        begin: dict[str, Any] = dict.fromkeys(texts, "") | {name: [] for name in lists}
        begin |= dict.fromkeys(("cut_x", "cut_y", "cut_z", "ratio"), 1.0) | {"trame__title": "voxgran", "shown": 0}
        begin |= {"colors": ["diameter"], "color_by": "diameter", "ways": [GRAINS], "way": GRAINS}
        self.state.update({**begin, "forms": desk.forms, "errors": {}, "upload": None, "engines": list(engines())})
        self.state.change("forms")(self.caught(self.edited))
        self.state.change("upload")(self.caught(self.take))
        self.state.change("color_by", "way")(self.caught(self.redraw))
        self.state.change("cut_x", "cut_y", "cut_z")(self.caught(self.cut))
        self.scan = ScanPane(desk, self.state, self.show)
        self.view: Any = None
        self.grown, self.due, self.wanted, self.edits, self.follows = (0, 0), 0.0, False, 0, True
        self.shares, self.seen, self.still_at, self.took = WINDOW[0] / WINDOW[1], (), math.inf, 0.0
        #: browsers that are connected: nothing is drawn for none
        self.lookers = 0
        #: computes what may take long, so that the page answers meanwhile
        self.thread = ThreadPoolExecutor(1)
        self._build()
        self.desk.examine()
        self._tell_plan()

    def edited(self, **_: Any) -> None:
        """Take the forms as they stand in the browser; a section of another kind gets its own fields.

        The forms themselves are sent back only where their fields change, since a person goes on typing.
        """
        before = [form["kind"] for form in self.desk.forms]
        try:
            self.desk.forms = edited(self.desk.forms, self.state.forms)
        except InputError:
            self._send_forms()
            raise
        changed = [*map(spread, self.desk.forms), [form["kind"] for form in self.desk.forms] != before]
        if changed[-1]:
            self.desk.refresh()
        if any(changed):
            self._send_forms()
        self._examine()

    def _send_forms(self) -> None:
        """Send the forms to the browser; as where they are edited there, their scene is planned."""
        self.state.forms = self.desk.forms
        self.state.dirty("forms")

    def _examine(self) -> None:
        """Plan the scene of the forms, the last one where they change quickly."""
        self.edits = edit = self.edits + 1
        self._worked(lambda: self.desk.examine() if edit == self.edits else None, self._tell_plan)

    def _tell_plan(self, _: Any = None) -> None:
        """Show the plan, and the container where it has changed."""
        state = self.state
        state.update({name: getattr(self.desk, name) for name in (*PLANNED, "errors")} | {"python": self.desk.python()})
        empty, self.desk.empty = self.desk.empty, None
        if empty is not None:
            self.desk.look.show(empty)
            self._update()

    def changed(self, change: Callable[..., None], *given: Any) -> None:
        """Change the forms, by a function of the desk."""
        self._guarded(lambda: change(*given))
        self._send_forms()

    def take(self, **_: Any) -> None:
        """Take an uploaded file as one more shape, or as the image of a scan."""
        given = self.state.upload
        file = given[0] if isinstance(given, list) and given else given
        if not file:
            return
        self.state.uploaded, self.state.upload = "", None
        name, content = content_of(file)
        if Path(name).suffix.lower() in READERS:
            self._guarded(lambda: self.scan.open(self.desk.kept(name, content)))
            return

        def taken(told: str) -> None:
            self.state.uploaded = told
            self._send_forms()

        self._worked(lambda: self.desk.upload(name, content), taken)

    def pick(self, across: float, down: float) -> None:
        """Show the numbers of the grain at a place of the picture, in shares of its width and height."""
        look, packing = self.desk.look, self.desk.look.packing

        def told(numbers: list[Fact]) -> None:
            if look.packing is packing and look.picked == grain:
                self.state.grain, self.state.ways = list(map(asdict, numbers)), look.ways()
                self.redraw()

        if packing is not None and self.state.way == GRAINS:
            self.follows, look.picked = False, look.grain_at(across, down)
            grain = look.picked
            self._worked(lambda: [] if grain is None else numbers_of_grain(packing, grain), told)

    def run(self) -> None:
        """Queue the scene."""
        self._guarded(self.desk.run)
        self.follows = True

    def act(self, change: Callable[[Run], None], number: int) -> None:
        """Stop a run, or let it go on from its checkpoint, by a function of the queue."""
        self._guarded(lambda: change(self.desk.run_of(number)))

    def show(self, number: int, *, follows: bool = False) -> None:
        """Show the packing of a run; whether the view goes on to follow the runs as they are computed."""
        self.follows = follows

        def opened(packing: Packing) -> None:
            state = self.state
            state.shown, state.figures, state.colors = number, [], colors_of(packing)
            state.color_by = state.color_by if state.color_by in state.colors else "diameter"
            state.way = GRAINS if state.way.startswith(ALONE) or packing.forces is None else state.way
            state.results, state.lamps = self.desk.results, self.desk.lamps
            state.warnings, state.grain = self.desk.warnings, []
            self._draw(packing)
            state.ways = self.desk.look.ways()

        self._worked(lambda: self.desk.open(number), opened)

    def redraw(self, **_: Any) -> None:
        """Draw the packing again."""
        look, packing, way = self.desk.look, self.desk.look.packing, self.state.way
        if packing is not None and way.startswith(ALONE):
            # a clump takes a while
            self._worked(lambda: look.alone(way), lambda made: self._draw(packing, made))
        elif packing is not None:
            self._draw(packing)

    def _draw(self, packing: Packing, alone: Any = None) -> None:
        """Draw a packing as the page says, or what is made of its picked grain alone."""
        look, state = self.desk.look, self.state
        # another may be shown since
        if alone is None or (look.packing is packing and state.way.startswith(ALONE)):
            self._guarded(lambda: look.show(packing, color_by=state.color_by, way=state.way, alone=alone))
            self.cut()

    def draw_figures(self) -> None:
        """Show the figures of the report."""
        self._worked(self.desk.figures, lambda figures: self.state.update({"figures": figures}))

    def cut(self, **_: Any) -> None:
        """Cut the packing."""
        x, y, z = (as_number(self.state[f"cut_{axis}"], axis, at_least=0.0, at_most=1.0) for axis in "xyz")
        self.desk.look.cut((x, y, z))
        self._update()

    async def download(self, what: str) -> bytes | None:
        """Return a file of the run that is shown, or of the scene; None where there is none, which the page says."""
        self.state.error = ""
        try:
            if what == "picture.png":
                return self.desk.file(what)
            return await asyncio.get_running_loop().run_in_executor(self.thread, self.desk.file, what)
        except Exception as error:  # noqa: BLE001  (it is shown)
            self.failures.tell(error)
            return None

    async def watch(self) -> None:
        """Follow the runs, and send pictures, as long as the app is there."""
        while True:
            began = time.monotonic()
            for step in (self._follow, self._fit, self.scan.follow, self._draw_growth, self._push):
                self.caught(step)()
            self.state.runs = [run.told() for run in self.desk.queue.runs]
            self.caught(self.state.flush)()
            await asyncio.sleep(max(TICK, time.monotonic() - began))

    def _follow(self) -> None:
        """Take note of the runs that have ended, and show the last one if it is followed."""
        for run in self.desk.queue.poll():
            if run.state == "done" and self.follows:
                self.show(run.number, follows=True)

    def _draw_growth(self) -> None:
        """Draw the grains of the run that is computed, for those who look, in a small share of the time."""
        began = time.monotonic()
        if self.lookers and began > self.due and self._grow():
            self.due = began + REST * (time.monotonic() - began)

    def _grow(self) -> bool:
        """Show the grains of the run that is computed, where they were written since; return whether they were."""
        run = self.desk.queue.current
        if run is None or (run.number, run.grown) == self.grown or not (run.grown and self.follows):
            return False
        self.grown = (run.number, run.grown)
        with contextlib.suppress(VoxgranError):
            grown = load_packing(run.growing)
            self.desk.look.show(grown, way=SPHERES if grown.count > MANY else GRAINS)
            self._update()
        return True

    def _fit(self) -> None:
        """Keep what is seen where the proportions of the window change."""
        wide, high = self.desk.look.stage.window_size
        if not (wide and high):
            return
        # while the view is turned its pictures are smaller
        share = self.shares * high / wide
        if abs(share - 1) > 0.05:
            self.shares = wide / high
            self.desk.look.fit(share)
            self._update()

    def _push(self) -> None:
        """Send the picture; while it is turned it is smaller where it takes long, and smooth once it has rested."""
        if not self.lookers:
            return
        began, look, queue = time.monotonic(), self.desk.look, self.desk.queue
        before, self.seen = self.seen, (*look.seen(), *look.stage.window_size, self.lookers)
        if self.wanted or self.seen != before:
            self.still_at = began + STILL
        if self.wanted:
            self.wanted = False
            self.view.update()
            self.took = time.monotonic() - began
            self.state.ratio = round(min(1.0, max(0.25, (FRAME / max(self.took, 1e-9)) ** 0.5)), 2)
        elif began > self.still_at and self.took < SLOW and not (self.follows and queue.current):
            self.still_at = math.inf
            with look.smooth():
                self.view.update()

    def _worked(self, call: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Call a function in the thread, and another one with what it returns; the sentence of an error is shown."""

        async def wait() -> None:
            try:
                then(await asyncio.get_running_loop().run_in_executor(self.thread, call))
            except Exception as error:  # noqa: BLE001  (it is shown)
                self.failures.tell(error)
            self._update()
            self.state.flush()

        self.state.error = ""
        asyncio.get_running_loop().create_task(wait())

    def _guarded(self, call: Any) -> None:
        """Call a function; the sentence of an error goes to the page."""
        self.state.error = ""
        self.caught(call)()
        self._update()

    def _update(self) -> None:
        """Have the picture sent, once for all that ask for it meanwhile."""
        self.wanted = True

    def _build(self) -> None:
        """Lay out the page."""
        v3, html = load("trame.widgets.vuetify3"), load("trame.widgets.html")
        with load("trame.ui.vuetify3").VAppLayout(self.server, theme="light") as layout:
            with v3.VAppBar(density="compact", elevation=1):
                v3.VAppBarNavIcon(click="left = !left", id="left")
                v3.VAppBarTitle("voxgran", style="flex: none", v_if="$vuetify.display.width >= 600")
                told = "flex: 1; min-width: 0; max-height: 100%; overflow-y: auto; font-size: 13px; line-height: 1.2"
                html.Span("{{ error }}", classes="text-error mx-2", id="error", style=told)
                v3.VBtn("CT", click="scanning = !scanning", id="ct", min_width=0)
                preview = self.caught(partial(self._worked, self.desk.preview, self.desk.look.show_shapes))
                v3.VBtn("Preview", click=preview, id="preview", min_width=0, title="the first shapes of the scene")
                v3.VBtn("Run", click=self.caught(self.run), id="run", color="primary", variant="flat", classes="mx-2")
                v3.VAppBarNavIcon(click="right = !right", id="right")
            drawer = {"width": ("$vuetify.display.width < 1200 ? 250 : 320",), "permanent": True}
            with v3.VNavigationDrawer(v_model=("left", True), **drawer):
                self._forms(v3, html)
            with v3.VNavigationDrawer(v_model=("right", True), location="right", **drawer):
                self._results(v3, html)
            with v3.VMain(), v3.VContainer(fluid=True, classes="pa-0 d-flex flex-column", style="height: 100%"):
                self.scan.build(v3, html)
                self._tools(v3)
                with html.Div(style="flex: 1; min-height: 0", id="view", dblclick=(self.caught(self.pick), PLACE)):
                    stage, views = self.desk.look.stage, load("trame_pyvista.widgets")
                    self.view = views.PyVistaRemoteView(stage, interactive_ratio=("ratio",))
                    # it would send a picture for each part of the scene
                    stage.clear_on_render_callbacks()
            load("trame.widgets.client").Style("html { overflow-y: hidden }")
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
                    used = {"v_if": "!form.needed && form.number < 1", "label": "used", "color": "primary"}
                    v3.VSwitch(v_model="form.on", **used, **OF_FORM)
                    kinds = {"v_if": "form.kinds.length", "items": ("form.kinds",), "label": ("form.title",)}
                    v3.VSelect(v_model="form.kind", **kinds, **OF_FORM)
                    with html.Template(v_for="(field, k) in form.fields", key="k"):
                        v3.VSelect(v_if="field.choices.length", items=("['', ...field.choices]",), **FIELD)
                        v3.VTextarea(v_else_if="field.long", rows=1, auto_grow=True, **FIELD)
                        v3.VTextField(v_else=True, **FIELD)
                    narrow = "font: clamp(9px, .8vw, 11px) monospace"
                    with html.Div(v_if="form.name == 'sizes' && curve", style=narrow):
                        html.Div(v_html="curve", id="curve")
                        html.Pre("{{ held }}", style="font: inherit; white-space: pre-wrap", id="held")
                    removed = (self.caught(partial(self.changed, self.desk.remove)), "[index]")
                    v3.VBtn("Remove", v_if="form.number > 0", click=removed, size="small")
        v3.VBtn(
            "Add a shape", click=self.caught(lambda: self.changed(self.desk.add_shape)), variant="text", id="add-shape"
        )
        told = "mesh file, learned shapes (.nc), or scan"
        v3.VFileInput(v_model=("upload",), label="file", hint=told, persistent_hint=True, **UPLOAD)
        html.Pre("{{ uploaded }}", classes="text-caption px-4", style="white-space: pre-wrap", id="uploaded")

    def _results(self, v3: Any, html: Any) -> None:
        """Lay out plan, runs, numbers and files."""
        drawn = "'data:image/svg+xml,' + encodeURIComponent({})"
        with v3.VCard(title="Picked grain", variant="flat", density="compact", v_if="grain.length"):
            self._table(v3, html, "grain")
        with v3.VCard(title="Plan", variant="flat", density="compact"):
            html.Pre("{{ plan }}", classes="text-caption px-4 pb-2", style="white-space: pre-wrap", id="plan")
            with v3.VExpansionPanels(variant="accordion"), v3.VExpansionPanel(title="All of the plan"):
                with v3.VExpansionPanelText():
                    html.Pre("{{ details }}", classes="text-caption", style="white-space: pre-wrap", id="details")
        with v3.VCard(title="Runs", variant="flat", density="compact", style="max-height: 50vh; overflow-y: auto"):
            with html.Div(v_for="run in [...runs].reverse()", key="run.number", classes="px-4 py-1 run"):
                html.Span("{{ run.number }}: {{ run.state }} {{ run.error }}")
                left = "{{ run.left === null ? '' : ', about ' + run.left + ' s left' }}"
                html.Span(f"{{{{ run.stage }}}} {{{{ run.text }}}}{left}", v_if="run.state == 'running'")
                html.Div("{{ text }}", v_for="text in run.warnings", classes="text-caption text-warning")
                v3.VProgressLinear(v_if="run.state == 'running'", model_value=("run.percent",), color="primary")
                for word, act, states in (
                    ("Stop", partial(self.act, self.desk.queue.stop), ["running", "waiting"]),
                    ("Go on", partial(self.act, self.desk.queue.go_on), ["stopped", "failed"]),
                    ("Show", self.show, ["done"]),
                ):
                    does = {"click": (self.caught(act), "[run.number]"), "classes": word.lower().replace(" ", "-")}
                    v3.VBtn(word, v_if=f"{states}.includes(run.state)", size="x-small", **does)
        with v3.VCard(title="Results", variant="flat", density="compact", v_if="shown"):
            with html.Div(v_for="lamp in lamps", key="lamp.name", classes="px-4 lamp"):
                color = ("lamp.ok ? 'success' : lamp.ok === null ? 'grey' : 'error'",)
                v3.VIcon("mdi-circle", color=color, size="small")
                html.Span(" {{ lamp.name }}: {{ lamp.text }}", classes="text-caption")
            self._table(v3, html, "results")
            html.Div("{{ text }}", v_for="text in warnings", classes="px-4 text-caption text-warning")
            for name, file in Desk.FILES.items():
                take = TAKE.format(file=f"'{file}'")
                turns = {"loading": (f"taking == '{file}'",), "id": f"take-{file}"}
                v3.VBtn(name, size="small", variant="outlined", classes="ma-1", click=take, **turns)
            html.Div("Input of engines, with material and clumps as in the forms", classes="px-4 text-caption")
            file = "engine + '.zip'"
            taking = {"click": TAKE.format(file=file), "loading": (f"taking == {file}",), "id": (f"'take-' + {file}",)}
            v3.VBtn("{{ engine }}", v_for="engine in engines", size="x-small", variant="text", **taking)
            v3.VBtn(
                "Figures of the report",
                click=self.caught(self.draw_figures),
                size="small",
                classes="ma-1",
                id="figures",
            )
            with html.Div(v_for="figure in figures", key="figure.alt", classes="px-4 figure", title=("figure.alt",)):
                html.Img(src=(drawn.format("figure.svg"),), style="width: 100%", click="large = figure.svg")
                html.Div("{{ figure.caption }}", classes="text-caption")
            with v3.VDialog(model_value=("!!large",), update_modelValue="large = ''", max_width=900):
                html.Img(src=(drawn.format("large"),), style="width: 100%; background: white", id="large")
        with v3.VCard(title="The same in Python", variant="flat", density="compact"):
            html.Pre("{{ python }}", classes="px-4", style=CODE, id="python")
        self.server.controller.trigger("download")(self.download)

    def _table(self, v3: Any, html: Any, name: str) -> None:
        """Lay out facts as a table, whose notes are seen where the pointer rests."""
        with v3.VTable(density="compact", v_if=f"{name}.length", classes="text-caption mx-2", id=name), html.Tbody():
            with html.Tr(v_for=f"row in {name}", key="row.label", title=("row.note",), style="line-height: 1.2"):
                html.Td("{{ row.label }}", style="height: auto")
                html.Td("{{ row.value }}", style="height: auto", classes=("({bad: 'text-error'})[row.tone]",))

    def _tools(self, v3: Any) -> None:
        """Lay out what changes the view: what is drawn, colours, cuts."""
        bare = {"density": "compact", "hide_details": True, "style": "min-width: 100px; max-width: 240px"}
        share = {"min": 0, "max": 1, "step": 0.01, "classes": "mx-2"}
        with v3.VRow(dense=True, no_gutters=True, classes="px-2 align-center", style="flex: 0"):
            v3.VSelect(v_model=("way",), items=("ways",), label="show", id="way", **bare)
            v3.VSelect(v_model=("color_by",), items=("colors",), label="colour by", id="color-by", **bare)
            for axis in "xyz":
                v3.VSlider(v_model=(f"cut_{axis}",), label=axis, id=f"cut-{axis}", **share, **bare)
