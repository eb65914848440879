"""A scan that is worked on: opened, segmented, looked at in slices, made into a packing with files as of a run.

:class:`ScanProcess` does so in a process of its own, so that who asks can answer others meanwhile.
"""

import base64
import shutil
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.errors import InputError, PackingWarning, VoxgranError
from voxgran.lattice.image import Image
from voxgran.lattice.segment import Segmentation, segment
from voxgran.packing.transform.from_labels import packing_of_labels
from voxgran.report.slices import kinds_of, outlined
from voxgran.report.stage import png_of
from voxgran.scene.processes import Channel, Process, start
from voxgran.scene.run import PACKING, finish_folder, opened_folder
from voxgran.scene.scene import Scene
from voxgran.shapes.images.image_files import with_lattice
from voxgran.shapes.images.labels import image_of

#: what can be said of a scan, and what it means
FIELDS = {
    "path": "image (.npy, .npz, .tif, .vti, .nrrd, .mha), or a folder of DICOM slices",
    "voxel_size": "edge, or [5, 5, 8]; default: of the file",
    "unit": "of the edges",
    "min_size": "voxels of the smallest grains; default: 64",
    "gravity": "such as -z; default: nowhere",
}
#: what is said while something is done, and the field of which an error is that names none
DOING = {
    "open": ("reading and segmenting", "path"),
    "segment": ("segmenting", "threshold"),
    "draw": ("", "threshold"),
    "finish": ("making the packing", "gravity"),
}
#: suspects that are named, and the sections of a scene that say how a scan is checked, measured and kept
NAMED, KEPT = 8, ("scene", "material", "measure", "output")


@dataclass(slots=True, eq=False)
class Scan:
    """A grey image and its labels. Methods take what they need of the same keywords, and return what can be sent.

    Attributes
    ----------
    path : Path
        Where the image is.
    image : Image or None
        The image, once it is opened.
    found : Segmentation or None
        Its labels.
    given : dict
        Options with which they were found.
    span : (float, float)
        Smallest and largest grey value.
    proposed : float
        The separation for a grain of the median size, where none is given.
    """

    path: Path = Path()
    image: Image | None = None
    found: Segmentation | None = None
    given: dict[str, Any] | None = None
    span: tuple[float, float] = (0.0, 1.0)
    proposed: float = 0.0

    def open(self, *, path: Path, voxel_size: Any = None, unit: str | None = None, **rest: Any) -> dict[str, Any]:
        """Read an image, and segment it with the threshold and separation that are proposed; if that fails, the one
        that was open stays.

        Raises
        ------
        VoxgranError
            If it cannot be read or segmented.
        """
        image = with_lattice(image_of(path, None), voxel_size, unit)
        before, self.path, self.image = (self.path, self.image), path, image
        try:
            told = self.segment(**{**rest, "threshold": "otsu", "separation": None})
        except VoxgranError:
            self.path, self.image = before
            raise
        self.proposed = told["separation"]
        low, high = (np.asarray(end).item() for end in (image.values.min(), image.values.max()))
        self.span = (float(low), float(high))
        size = "of unknown edges" if image.voxel_size is None else " x ".join(f"{edge:g}" for edge in image.voxel_size)
        about = f"{' x '.join(map(str, image.values.shape))} voxels {size} {image.unit or ''}".rstrip()
        # a tenth of the largest distance to the void in a grain of the median size is proposed
        ends = {"low": low, "high": high, "widest": 10 * self.proposed}
        return {**told, **ends, "about": f"{about}, grey values {low:.5g} to {high:.5g}"}

    def segment(
        self, *, threshold: float | str, separation: float | None, dark: bool = False, min_size: Any = None, **_: Any
    ) -> dict[str, Any]:
        """Segment the image as :func:`voxgran.segment`; the separation that was proposed stays that of the library,
        which follows the sizes of the grains.

        Raises
        ------
        VoxgranError
            If none is open, or it cannot be segmented.
        """
        given: dict[str, Any] = {"threshold": threshold, "dark_grains": dark}
        given |= {} if separation in (None, self.proposed) else {"separation": separation}
        given |= {} if min_size is None else {"min_size": min_size}
        found = segment(self._opened(), **given)
        self.found, self.given = found, {**given, "threshold": found.threshold}
        pairs = np.column_stack([found.suspects["grain"], found.suspects["other"]]).tolist()
        names = {"perhaps one": [f"{a} and {b}" for a, b in pairs if a != b]}
        names["perhaps several"] = [str(a) for a, b in pairs if a == b]
        told = [f"{found.grains} grains, {len(pairs)} in doubt"]
        told += [f"{words}: {', '.join(some[:NAMED])}" for words, some in names.items() if some]
        ends = {"threshold": found.threshold, "separation": separation or found.separation}
        return {**ends, "found": "; ".join(told), "python": self.python()}

    def draw(self, *, at: Sequence[float], threshold: float, dark: bool = False, **_: Any) -> dict[str, Any]:
        """Return the slices across x, y and z at shares of the lengths, with the outlines of the labels, or of the
        solid where labels are those of another threshold: each with its ``source`` and the ``aspect`` of its lengths.

        Raises
        ------
        InputError
            If no image is open.
        """
        image, found, (low, high) = self._opened(), self.found, self.span
        values, lengths = image.values, np.multiply(image.values.shape, image.voxel_size or 1.0)
        if found is not None and self.given != {**(self.given or {}), "threshold": threshold, "dark_grains": dark}:
            found = None
        kinds = np.array([0, 1]) if found is None else kinds_of(found)
        made = []
        for axis, share in enumerate(at):
            k = min(int(share * values.shape[axis]), values.shape[axis] - 1)
            plane = tuple(k if other == axis else slice(None) for other in range(3))
            grey = np.asarray(values[plane], dtype=np.float64)
            solid: Any = grey < threshold if dark else grey > threshold
            labels = solid.astype(np.int64) if found is None else np.asarray(found.labels[plane])
            picture = outlined((grey - low) / (high - low or 1.0), labels, kinds)
            shot = np.ascontiguousarray(np.round(255 * picture.transpose(1, 0, 2)[::-1]).astype(np.uint8))
            wide, tall = np.delete(lengths, axis).tolist()
            source = f"data:image/png;base64,{base64.b64encode(png_of(shot)).decode()}"
            made.append({"source": source, "aspect": wide / tall})
        return {"slices": made}

    def finish(
        self, *, folder: Path, mapping: Mapping[str, Any], base: Path, gravity: Any = None, **_: Any
    ) -> dict[str, Any]:
        """Make the packing of the labels, and check, measure and save it as the run of a scene.

        Parameters
        ----------
        folder : Path
            Where results go; it is removed if there are none.
        mapping : mapping
            A scene, of which seed, material, measures and files are taken.
        base : Path
            Folder in which the files that it names are looked for.
        gravity : str or (3,) array_like of float, optional
            As of :func:`voxgran.packing_of_labels`.

        Returns
        -------
        dict
            The ``folder``, and the ``scene`` that begins with the grains of this packing.

        Raises
        ------
        VoxgranError
            If no image is open, the mapping is no scene, or the packing cannot be made or saved.
        """
        try:
            packing = packing_of_labels(self.found or self._opened(), gravity=gravity)
            scene: dict[str, Any] = {name: mapping[name] for name in KEPT if name in mapping}
            scene["scene"] = {**scene.get("scene", {}), "unit": packing.unit}
            scene |= {"shape": [{"family": "sphere"}], "container": packing.container.to_mapping()}
            scene["packing"] = {"method": "rsa", "count": 0}
            checked = Scene.from_mapping(scene, folder=base)
            with opened_folder(folder, resume=False, overwrite=False) as place:
                finish_folder(packing, place, scene=checked)
        except VoxgranError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        scene["packing"]["start"] = str((folder / PACKING).resolve())
        return {"folder": str(folder), "scene": scene, "python": self.python(gravity)}

    def python(self, gravity: Any = None) -> str:
        """Return the Python that makes the same packing."""
        image, given = self._opened(), ", ".join(f"{name}={value!r}" for name, value in (self.given or {}).items())
        lattice = "" if image.voxel_size is None else f", voxel_size={image.voxel_size}"
        lattice += "" if image.unit is None else f", unit={image.unit!r}"
        down = "" if gravity is None else f", gravity={gravity!r}"
        return (
            f"import voxgran as vg\n\nimage = vg.load_image({str(self.path)!r}{lattice})\n"
            f"labels = vg.segment(image, {given})\npacking = vg.packing_of_labels(labels{down})\n"
        )

    def _opened(self) -> Image:
        """Return the image.

        Raises
        ------
        InputError
            If none is open.
        """
        if self.image is None:
            raise InputError("path is of no image that was opened: open one first")
        return self.image


def serve(channel: Channel) -> None:
    """Call methods of a scan that come with their keywords, one after another; send back what each returns, with the
    sentences of warnings as ``said``, or the sentence of its error by the field that it names as ``errors``.
    """
    scan = Scan()
    while True:
        name, given = channel.receive()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", PackingWarning)
            try:
                answer = getattr(scan, name)(**given)
            except VoxgranError as error:
                named = next((word for word in (*FIELDS, *given) if str(error).startswith(word)), DOING[name][1])
                answer = {"errors": {named: str(error)}}
            else:
                told = [str(one.message) for one in said if issubclass(one.category, PackingWarning)]
                answer |= {} if name == "draw" else {"said": told, "errors": {}}
        channel.send(answer)


@dataclass(slots=True, eq=False)
class ScanProcess:
    """A process with a scan, which does one thing after another.

    Attributes
    ----------
    doing : str
        The method of the scan that it computes; empty where it waits.
    process : Process or None
        The process, once it was started.
    failed : str
        Why it could not be asked.
    """

    doing: str = ""
    process: Process | None = None
    failed: str = ""

    @property
    def words(self) -> str:
        """What it does, in words; empty where it waits."""
        return DOING[self.doing][0] if self.doing else ""

    def begin(self, name: str, given: Mapping[str, Any]) -> None:
        """Begin a method of the scan; a process that has ended is replaced by another, which has no image."""
        self.doing, self.failed = name, ""
        try:
            if self.process is None or self.process.process.poll() is not None:
                self.process = start(serve, Process)
            self.process.connection.send((name, dict(given)))
        except (OSError, VoxgranError) as error:
            self.failed = str(error)

    def stop(self) -> None:
        """End the process, and with it what it computes; its image is no longer open."""
        if self.process is not None:
            self.process.end()
        self.process, self.doing = None, ""

    def answer(self) -> dict[str, Any] | None:
        """Return what the method returned, or the sentence of its error as ``errors``; None while it computes."""
        name = self.doing
        if not name or not (self.failed or (self.process is not None and self.process.connection.poll())):
            return None
        self.doing = ""
        try:
            told: dict[str, Any] | None = None if self.process is None or self.failed else self.process.receive()
        except VoxgranError as error:
            # the process has ended
            self.failed, told = str(error), None
        return {"errors": {DOING[name][1]: self.failed}} if told is None else told
