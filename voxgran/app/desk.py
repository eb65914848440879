"""What lies behind the page: the scene that is put together, its plan, the runs, and the packing that is looked at."""

import pprint
import re
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from voxgran._base.errors import InputError, VoxgranError, shown
from voxgran._base.files import as_path, made_folder, write_files
from voxgran.app.forms import Form, forms_of, mapping_of, rest_of, scene_of
from voxgran.app.look import Look
from voxgran.app.runs import Queue, Run, heard
from voxgran.contacts.verify import Verification, verify
from voxgran.decks.engine import engines
from voxgran.io.files import load
from voxgran.io.netcdf import load_statistics, save_statistics
from voxgran.measures.model import measure
from voxgran.packing.model import Packing
from voxgran.report.facts import MOSTLY, headline
from voxgran.report.figures import figures_of
from voxgran.report.page import save_report
from voxgran.report.plots import planned_svg
from voxgran.report.stage import png_of, shot
from voxgran.scene.checked_sections import located, read_toml
from voxgran.scene.entries import ShapeEntry
from voxgran.scene.run import deck_of
from voxgran.scene.scene import Scene
from voxgran.scene.shape_files import entry_of_file
from voxgran.settling.equilibrium import equilibrium
from voxgran.shapes.model import Shape

#: shapes of a preview
PREVIEW = 5
#: lines of a plan that are shown first
HEADLINES = ("grains", "bed", "memory", "time", "note")
#: largest number of grains whose forces are computed where a packing stores none
JUDGED = 2000
#: a shape that is added
SPHERE = {"family": "sphere"}
#: files of a run
REPORT, STATISTICS = "report.html", "statistics.nc"


class Desk:
    """A scene that is put together, and its runs."""

    #: what can be taken away, by the words of its button
    FILES: ClassVar[dict[str, str]] = {
        "Packing": "packing.vtp",
        "Scene": "scene.toml",
        "Report": REPORT,
        "Statistics": STATISTICS,
        "Picture": "picture.png",
        "Python": "scene.py",
    }

    def __init__(self, mapping: dict[str, Any], folder: Path, base: Path) -> None:
        self.forms: list[Form] = forms_of(mapping)
        self.rest = rest_of(mapping)
        self.base = base
        self.queue = Queue(folder, base)
        self.look = Look()
        self.plan = self.details = self.error = self.curve = self.held = ""
        self.drawn: dict[str, Any] = {}
        self.made: tuple[ShapeEntry, ...] = ()  # entries of which shapes can be made
        self.empty: Packing | None = None  # the container where it has changed, which is to be drawn
        self.errors: dict[str, str] = {}
        self.shown: Run | None = None
        self.proof: Verification | None = None
        self.statistics: Any = None
        self.packing: Packing | None = None
        self.results: list[dict[str, str]] = []
        self.warnings: list[str] = []
        self.lamps: list[dict[str, Any]] = []

    @property
    def mapping(self) -> dict[str, Any]:
        """The scene as it stands in the forms."""
        return scene_of(self.rest | mapping_of(self.forms))

    def refresh(self, **more: Any) -> None:
        """Give each section the fields of its kind, with the values that it has or that are given."""
        kinds = {(form["name"], form["number"]): form["kind"] for form in self.forms}
        self.forms = forms_of(mapping_of(self.forms) | more)
        for form in self.forms:
            if not form["on"]:
                form["kind"] = kinds.get((form["name"], form["number"]), form["kind"])

    def examine(self) -> None:
        """Plan the scene; the sentence of an error goes to the section that it names."""
        self.error = self.plan = self.details = self.curve = self.held = ""
        self.errors, said = {}, list[str]()
        try:
            with heard(said.append):
                scene = Scene.from_mapping(self.mapping, folder=self.base)
                if scene.container.to_mapping() != self.drawn:
                    self.drawn, none = scene.container.to_mapping(), np.empty((0, 3))
                    self.empty = Packing.of((), scene.container, position=none, unit=scene.general.unit)
                if scene.shapes != self.made:
                    self.preview(scene)
                made = scene.plan()
                how: dict[str, Any] = {"dimension": scene.container.dimension, "unit": scene.general.unit}
                self.curve, self.held = planned_svg(scene.sizes, made.sizes, **how), str(made.sizes or "")
        except VoxgranError as error:
            self.error = str(error)
            self.errors = _errors_of(self.forms, self.error)
            return
        self.details = str(made)
        lines = [line for line in self.details.splitlines() if line.startswith(HEADLINES)]
        self.plan = "\n".join(" ".join(line.split()) for line in [*lines, *said] if line)

    def add_shape(self, entry: Mapping[str, Any] = SPHERE) -> None:
        """Add a shape after the others."""
        self.refresh(shape=[*mapping_of(self.forms).get("shape", ()), entry])

    def remove(self, index: int) -> None:
        """Remove a shape.

        Raises
        ------
        InputError
            If it is the only one, or there is none.
        """
        shapes = [k for k, form in enumerate(self.forms) if form["name"] == "shape"]
        if len(shapes) < 2:
            raise InputError("the only shape cannot be removed: a scene needs one; add another first")
        if index not in shapes:
            raise InputError(
                f"there is no shape in section {shown(index)}: shapes are in {shapes}; load the page again"
            )
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
        self.add_shape(entry)
        return told

    def kept(self, name: str, content: bytes) -> Path:
        """Keep an upload, and return its file.

        Raises
        ------
        InputError
            If the name is none of a file.
        OutputError
            If it cannot be written.
        """
        place = as_path(made_folder(self.queue.folder.resolve() / "uploads") / Path(name).name)
        if place.name in ("..", "uploads"):
            raise InputError(f"the upload is called {shown(name)}: that is no name of a file; rename it")
        named, number = place, 1
        while place.exists():  # an upload of that name may be a shape of a run
            number += 1
            place = as_path(named.with_stem(f"{named.stem}_{number}"))
        write_files({place: content}, overwrite=False)
        return place

    def preview(self, scene: Scene | None = None) -> list[Shape]:
        """Return the first shapes of a scene, by default that of the forms.

        Raises
        ------
        InputError
            If a shape cannot be made; some parameters are checked only then.
        """
        scene = scene or Scene.from_mapping(self.mapping, folder=self.base)
        made: list[Shape] = []
        for entry in scene.shapes:
            few = None if entry.count is None else min(entry.count, PREVIEW)
            try:
                made += replace(entry, count=few).make()
            except VoxgranError as error:
                raise InputError(f"[[shape]] {entry.name} {error}") from error
        self.made = scene.shapes
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

    def open(self, number: int) -> Packing:
        """Return the packing of a run, which is shown with its numbers."""
        run = self.run_of(number)
        packing = self.packing = load(run.packing)
        self.shown = run
        said: list[str] = []
        left, which = run.folder / STATISTICS, ["density", "coordination"]
        with heard(said.append):
            proof = self.proof = verify(packing)
            kept = self.statistics = load_statistics(left) if left.exists() else measure(packing, which=which)
            self.results = list(map(asdict, headline(packing, kept, proof)))
        self.warnings = [text for text in said if text not in run.warnings]
        self.lamps = [
            {"name": "verify", "ok": proof.ok, "text": proof.summary().splitlines()[0]},
            rest_of_grains(packing),
        ]
        return packing

    def figures(self) -> list[dict[str, str]]:
        """Return the figures of the report of the run that is shown."""
        made = [] if self.packing is None else figures_of(self.packing, self.statistics)
        return [{"alt": one.alt, "caption": one.caption, "svg": one.svg} for one in made]

    def python(self, mapping: dict[str, Any] | None = None) -> str:
        """Return the Python that makes the same packing, of a scene or of that in the forms."""
        text = pprint.pformat(mapping or located(self.mapping, self.base), sort_dicts=False, width=44)
        return f"import voxgran as vg\n\nscene = vg.Scene.from_mapping({text})\nresult = scene.run('out')\n"

    def file(self, name: str) -> bytes:
        """Return the content of a file to take away.

        Raises
        ------
        InputError
            If the name is of no such file, no run is shown, or an engine cannot hold its grains.
        """
        known = [*self.FILES.values(), *(f"{engine}.zip" for engine in engines())]
        if name not in known:
            raise InputError(f"there is no file {shown(name)}: there are {', '.join(known)}; choose one")
        if self.shown is None or self.packing is None:
            raise InputError("no run is shown: show one first")
        scene = self.shown.folder.with_suffix(".toml")
        if name == "scene.py":
            return self.python(read_toml(scene)).encode()
        if name == "picture.png":
            with self.look.smooth():
                return png_of(shot(self.look.stage))
        path = scene if name == "scene.toml" else self.shown.folder / name
        return path.read_bytes() if path.exists() else self._made(name, read_toml(scene))

    def _made(self, name: str, mapping: dict[str, Any]) -> bytes:
        """Make a file that the run of a scene has not left; that of an engine has material and clumps of the forms."""
        assert self.packing is not None
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / name
            if name == REPORT:
                save_report(self.packing, place, statistics=self.statistics, verification=self.proof)
            elif name == STATISTICS:
                save_statistics(self.statistics, place)
            else:
                asked = {key: self.mapping.get(key, {}) for key in ("material", "output")}
                deck_of(self.packing, place.with_suffix(""), Scene.from_mapping(mapping | asked), place.stem)
                shutil.make_archive(str(place.with_suffix("")), "zip", folder, place.stem)
            return place.read_bytes()


def content_of(file: Any) -> tuple[str, bytes]:
    """Return name and content of an upload as a page sends it.

    Raises
    ------
    InputError
        If it is none.
    """
    name, content = (file.get("name"), file.get("content")) if isinstance(file, dict) else (None, None)
    if isinstance(content, list) and all(isinstance(part, bytes) for part in content):
        content = b"".join(content)
    if not (isinstance(name, str) and isinstance(content, bytes)):
        raise InputError(f"the upload {shown(name)} has no name or no content: choose the file again")
    return name, content


def rest_of_grains(packing: Packing) -> dict[str, Any]:
    """Return whether the grains rest, as a lamp, None where it is not known; forces that are not stored are computed
    for packings that are not large.
    """
    balanced: bool | None = packing.stop_reason in ("settled", "compressed")
    if packing.forces is not None:
        share = packing.forces.share_at_rest
    elif packing.gravity is None or not packing.count:
        return {"name": "equilibrium", "ok": None, "text": "not judged: without gravity and stored forces"}
    elif packing.count > JUDGED:
        text = f"not judged: no forces are stored of {packing.count} grains; voxgran equilibrium says"
        return {"name": "equilibrium", "ok": None, "text": text}
    else:
        share = equilibrium(packing).attrs["share_at_rest"]
        balanced = share >= MOSTLY
    return {"name": "equilibrium", "ok": balanced, "text": f"{100 * share:.1f} % of the grains rest"}


def _errors_of(forms: list[Form], text: str) -> dict[str, str]:
    """Return the sentence of an error by the numbers of the sections that it names, and of their fields."""
    words = re.findall(r"\w+", text.partition(":")[0])
    found: dict[str, str] = {}
    for k, form in enumerate(forms):
        if form["on"] and (f"[{form['name']}]" in text or words[:1] in ([form["name"]], [form["kind"]])):
            found |= {str(k): text} | {f"{k}.{one['name']}": text for one in form["fields"] if one["name"] in words}
    return found
