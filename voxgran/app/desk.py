"""What lies behind the page: the scene that is put together, its plan, the runs, and the packing that is looked at."""

import pprint
import shutil
import tempfile
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from voxgran._base.errors import InputError, VoxgranError
from voxgran.app.forms import Form, blank_shape, forms_of, mapping_of, rest_of
from voxgran.app.look import Look
from voxgran.app.runs import Queue, Run, heard, toml_of
from voxgran.contacts.verify import verify
from voxgran.io.files import load
from voxgran.measures.model import measure
from voxgran.packing.model import Packing
from voxgran.report.plots import planned_svg
from voxgran.report.stage import png_of, shot
from voxgran.scene.run import deck_of
from voxgran.scene.scene import Scene
from voxgran.scene.shape_files import entry_of_file
from voxgran.shapes.model import Shape

#: shapes of a preview
PREVIEW = 5
#: lines of a plan that are shown first
HEADLINES = ("grains", "bed", "memory", "note")
#: headline numbers, where the measures have them
NUMBERS = ("bulk_solid_fraction", "bed_solid_fraction", "solid_fraction", "mean_coordination_number")


class Desk:
    """A scene that is put together, and its runs."""

    #: what can be taken away, by the words of its button
    FILES: ClassVar[dict[str, str]] = {
        "Packing": "packing.vtp",
        "Scene": "scene.toml",
        "Report": "report.html",
        "Statistics": "statistics.nc",
        "Picture": "picture.png",
    }

    def __init__(self, mapping: dict[str, Any], folder: Path, base: Path) -> None:
        self.forms: list[Form] = forms_of(mapping)
        self.rest = rest_of(mapping)
        self.base = base
        self.queue = Queue(folder, base)
        self.look = Look()
        self.plan = self.details = self.error = self.curve = self.held = ""
        self.drawn: dict[str, Any] = {}
        self.empty: Packing | None = None  # the container where it has changed, which is to be drawn
        self.errors: dict[str, str] = {}
        self.shown: Run | None = None
        self.results: list[dict[str, str]] = []
        self.warnings: list[str] = []
        self.lamps: list[dict[str, Any]] = []

    @property
    def mapping(self) -> dict[str, Any]:
        """The scene as it stands in the forms."""
        return self.rest | mapping_of(self.forms)

    def refresh(self) -> None:
        """Give each section the fields of its kind, with the values that it has."""
        kept = {(form["name"], form["number"]): form for form in self.forms}
        self.forms = forms_of(self.mapping)
        for form in self.forms:
            before = kept.get((form["name"], form["number"]))
            if before is not None and not form["on"]:
                form["kind"] = before["kind"]

    def examine(self) -> None:
        """Plan the scene; the sentence of an error goes to the section that it names."""
        self.error, self.plan, self.details, self.errors, self.curve, self.held = "", "", "", {}, "", ""
        said: list[str] = []
        try:
            with heard(said.append):
                scene = Scene.from_mapping(self.mapping, folder=self.base)
                if scene.container.to_mapping() != self.drawn:
                    self.drawn, none = scene.container.to_mapping(), np.empty((0, 3))
                    self.empty = Packing.of((), scene.container, position=none, unit=scene.general.unit)
                made = scene.plan()
                how: dict[str, Any] = {"dimension": scene.container.dimension, "unit": scene.general.unit}
                self.curve, self.held = planned_svg(scene.sizes, made.sizes, **how), str(made.sizes or "")
        except VoxgranError as error:
            self.error = str(error)
            named = (k for k, form in enumerate(self.forms) if f"[{form['name']}]" in self.error)
            self.errors = {str(k): self.error for k in named}
            return
        self.details = str(made)
        lines = [line for line in self.details.splitlines() if line.startswith(HEADLINES)]
        seconds = f"time            about {made.seconds:.0f} s" if made.seconds >= 1 else ""
        self.plan = "\n".join(" ".join(line.split()) for line in [*lines, seconds, *said] if line)

    def add_shape(self) -> None:
        """Add a shape after the others."""
        last = max(k for k, form in enumerate(self.forms) if form["name"] == "shape")
        number = sum(form["name"] == "shape" for form in self.forms)
        self.forms.insert(last + 1, blank_shape(number))

    def remove(self, index: int) -> None:
        """Remove a shape.

        Raises
        ------
        InputError
            If it is the only one.
        """
        if sum(form["name"] == "shape" for form in self.forms) < 2:
            raise InputError("the only shape cannot be removed: a scene needs one; add another first")
        del self.forms[index]
        self.refresh()

    def upload(self, name: str, content: bytes) -> str:
        """Take a mesh file, or a learned distribution of shapes, as one more shape; return what was found in it.

        Raises
        ------
        VoxgranError
            If it is neither, or a mesh that cannot be mended.
        """
        place = self.kept(name, content)
        try:
            with heard(lambda _: None):
                entry, told = entry_of_file(place)
        except VoxgranError:
            place.unlink()
            raise
        self.forms = forms_of(self.mapping | {"shape": [*self.mapping["shape"], entry]})
        return told

    def kept(self, name: str, content: bytes) -> Path:
        """Keep an upload, and return its file."""
        place = self.queue.folder / "uploads" / Path(name).name
        place.parent.mkdir(parents=True, exist_ok=True)
        named, number = place, 1
        while place.exists():  # an upload of that name may be a shape of a run
            number += 1
            place = named.with_stem(f"{named.stem}_{number}")
        place.write_bytes(content)
        return place

    def preview(self) -> list[Shape]:
        """Return some of the shapes of the scene."""
        scene = Scene.from_mapping(self.mapping, folder=self.base)
        made = [shape for entry in scene.shapes for shape in entry.make()]
        return made[:PREVIEW]

    def run(self) -> Run:
        """Queue the scene."""
        return self.queue.add(self.mapping)

    def run_of(self, number: int) -> Run:
        """Return the run of a number.

        Raises
        ------
        InputError
            If there is none.
        """
        found = next((run for run in self.queue.runs if run.number == number), None)
        if found is None:
            raise InputError(
                f"there is no run {number}: runs have the numbers {[run.number for run in self.queue.runs]}"
            )
        return found

    def open(self, number: int) -> None:
        """Show the packing of a run, with its numbers."""
        run = self.run_of(number)
        packing, self.shown = load(run.packing), run
        self.look.show(packing)
        self.warnings = []
        with heard(self.warnings.append):
            proof, numbers = verify(packing), measure(packing, which=["density", "coordination"])
        told = {name: float(numbers[name]) for name in NUMBERS if name in numbers}
        self.results = [
            {"name": name.replace("_", " "), "text": f"{value:.4f}"} for name, value in told.items() if value == value
        ]
        rest = packing.forces
        self.lamps = [{"name": "verify", "ok": proof.ok, "text": proof.summary().splitlines()[0]}]
        if rest is not None:
            text = f"{100 * rest.share_at_rest:.1f} % of the grains rest"
            self.lamps.append({"name": "equilibrium", "ok": packing.stop_reason == "settled", "text": text})

    def python(self) -> str:
        """Return the Python that makes the same packing."""
        text = pprint.pformat(self.mapping, sort_dicts=False, width=44)
        return f"import voxgran as vg\n\nscene = vg.Scene.from_mapping({text})\nresult = scene.run('out')\n"

    def file(self, name: str) -> bytes:
        """Return the content of a file to take away.

        Raises
        ------
        InputError
            If the run that is shown has no such file.
        """
        if name == "scene.toml" and self.shown is None:
            return toml_of(self.mapping).encode()
        if self.shown is None:
            raise InputError("no run is shown: show one first")
        if name == "picture.png":
            return png_of(shot(self.look.stage))
        if name.endswith(".zip"):
            return self._deck(name.removesuffix(".zip"))
        path = self.shown.folder.with_suffix(".toml") if name == "scene.toml" else self.shown.folder / name
        if not path.exists():
            raise InputError(f"run {self.shown.number} has no {name}: switch it on under Files, and run again")
        return path.read_bytes()

    def _deck(self, engine: str) -> bytes:
        """Return the input of an engine for the run that is shown, as a zip archive."""
        assert self.shown is not None
        scene = Scene.from_toml(self.shown.folder.with_suffix(".toml"))
        with tempfile.TemporaryDirectory() as folder:
            deck_of(load(self.shown.packing), Path(folder) / engine, scene, engine)
            return Path(shutil.make_archive(f"{folder}/{engine}", "zip", folder, engine)).read_bytes()
