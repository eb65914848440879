"""A scan that is worked on: opened, segmented, looked at in slices, made into a packing with files as of a run.

:class:`ScanProcess` does so in a process of its own, so that who asks can answer others meanwhile.
"""

import base64
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.errors import InputError, PackingWarning, TooLargeError, VoxgranError
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

#: suspects that are named, and the sections of a scene that say how a scan is checked, measured and kept
NAMED, KEPT = 8, ("scene", "material", "measure", "output")


@dataclass(slots=True, eq=False)
class Scan:
    """A grey image and its labels; what methods return can be sent to another process.

    Attributes
    ----------
    image : Image or None
        The image, once it is opened.
    found : Segmentation or None
        Its labels.
    span : (float, float)
        Smallest and largest grey value.
    dark : bool
        Whether grains are darker than the void.
    """

    image: Image | None = None
    found: Segmentation | None = None
    span: tuple[float, float] = (0.0, 1.0)
    dark: bool = False

    def open(self, path: str | os.PathLike[str], **given: Any) -> dict[str, Any]:
        """Read an image, with the edges of a voxel and their unit where they are given, and segment it as `segment`.

        Raises
        ------
        VoxgranError
            If it cannot be read or segmented.
        """
        lattice = {name: given.pop(name, None) for name in ("voxel_size", "unit")}
        self.image, self.found = None, None
        image = with_lattice(image_of(path, None), **lattice)
        self.image = image
        told = self.segment(**given)
        values = np.asarray(image.values.min()).item(), np.asarray(image.values.max()).item()
        self.span = (float(values[0]), float(values[1]))
        size = "edges of a voxel are not known" if image.voxel_size is None else f"voxels of {image.voxel_size}"
        shape = " x ".join(map(str, image.values.shape))
        about = f"{shape} voxels, {size}, grey values {values[0]:.5g} to {values[1]:.5g}"
        # a tenth of the largest distance to the void in a grain of the median size is proposed
        return {**told, "low": values[0], "high": values[1], "widest": 10 * told["separation"], "about": about}

    def segment(self, *, dark_grains: bool = False, **given: Any) -> dict[str, Any]:
        """Segment the image with the options of :func:`voxgran.segment`, and return what was found.

        Raises
        ------
        VoxgranError
            If none is open, or it cannot be segmented.
        """
        found = segment(self._opened(), dark_grains=dark_grains, **given)
        self.found, self.dark = found, dark_grains
        pairs = np.column_stack([found.suspects["grain"], found.suspects["other"]]).tolist()
        one = [f"{a} and {b}" for a, b in pairs if a != b][:NAMED]
        several = [str(a) for a, b in pairs if a == b][:NAMED]
        told = [f"{found.grains} grains, {len(pairs)} suspects"]
        told += [f"perhaps one: {', '.join(one)}"] if one else []
        told += [f"perhaps several: {', '.join(several)}"] if several else []
        return {"threshold": found.threshold, "separation": found.separation, "found": "; ".join(told)}

    def draw(self, at: Sequence[float], *, threshold: float, dark_grains: bool = False) -> dict[str, Any]:
        """Return the slices across x, y and z at shares of the lengths, with the outlines of the labels, or of the
        solid where labels are those of another threshold: each with its ``source`` and the ``aspect`` of its lengths.

        Raises
        ------
        InputError
            If no image is open.
        """
        image, found, (low, high) = self._opened(), self.found, self.span
        values, edges = image.values, image.voxel_size or (1.0, 1.0, 1.0)
        labelled = found is not None and (found.threshold, self.dark) == (threshold, dark_grains)
        kinds = kinds_of(found) if found is not None and labelled else np.array([0, 1])
        made = []
        for axis, share in enumerate(at):
            k = min(int(share * values.shape[axis]), values.shape[axis] - 1)
            plane = tuple(k if other == axis else slice(None) for other in range(3))
            grey = np.asarray(values[plane], dtype=np.float64)
            solid = grey < threshold if dark_grains else grey > threshold
            labels = np.asarray(found.labels[plane]) if found is not None and labelled else solid.astype(np.int64)
            picture = outlined((grey - low) / (high - low or 1.0), labels, kinds)
            shot = np.round(255 * picture.transpose(1, 0, 2)[::-1]).astype(np.uint8)
            wide, tall = np.delete(np.multiply(values.shape, edges), axis).tolist()
            source = f"data:image/png;base64,{base64.b64encode(png_of(np.ascontiguousarray(shot))).decode()}"
            made.append({"source": source, "aspect": wide / tall})
        return {"slices": made}

    def finish(self, folder: Path, mapping: Mapping[str, Any], *, base: Path, gravity: Any = None) -> dict[str, Any]:
        """Make the packing of the labels, and check, measure and save it as the run of a scene.

        Parameters
        ----------
        folder : Path
            Where results go.
        mapping : mapping
            A scene, of which seed, material, measures and files are taken.
        base : Path
            Folder in which the files that it names are looked for.
        gravity : str or (3,) array_like of float, optional
            As of :func:`voxgran.packing_of_labels`.

        Returns
        -------
        dict
            The ``scene`` that begins with the grains of this packing.

        Raises
        ------
        VoxgranError
            If no image is open, the mapping is no scene, or the packing cannot be made or saved.
        """
        self._opened()
        packing = packing_of_labels(self.found, gravity=gravity)
        scene: dict[str, Any] = {name: mapping[name] for name in KEPT if name in mapping}
        scene["scene"] = {**scene.get("scene", {}), "unit": packing.unit}
        scene |= {"shape": [{"family": "sphere"}], "container": packing.container.to_mapping()}
        scene["packing"] = {"method": "rsa", "count": 0}
        checked = Scene.from_mapping(scene, folder=base)
        with opened_folder(folder, resume=False, overwrite=False) as place:
            finish_folder(packing, place, scene=checked)
        scene["packing"]["start"] = str((folder / PACKING).resolve())
        return {"scene": scene}

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
    """Call methods of a scan that come with their arguments, one after another; send back what each returns, or the
    sentence of its error, and the sentences of warnings.
    """
    scan = Scan()
    while True:
        name, given = channel.receive()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", PackingWarning)
            try:
                answer = getattr(scan, name)(**given)
            except VoxgranError as error:
                answer = str(error)
        told = [str(one.message) for one in said if issubclass(one.category, PackingWarning)]
        channel.send((answer, told))


@dataclass(slots=True, eq=False)
class ScanProcess:
    """A process with a scan, which does one thing after another.

    Attributes
    ----------
    doing : str
        The method of the scan that it computes; empty where it waits.
    """

    doing: str = ""
    process: Process | None = None

    def begin(self, name: str, given: Mapping[str, Any]) -> None:
        """Begin a method of the scan; a process that has ended is replaced by another, which has no image.

        Raises
        ------
        MissingLibraryError
            If no process can be started.
        """
        if self.process is None or self.process.process.poll() is not None:
            self.process = start(serve, Process)
        self.doing = name
        self.process.connection.send((name, dict(given)))

    def answer(self) -> tuple[dict[str, Any] | str, list[str]] | None:
        """Return what the method returned, or the sentence of its error, and its warnings; None while it computes."""
        if self.process is None or not self.doing or not self.process.connection.poll():
            return None
        self.doing = ""
        try:
            told: tuple[dict[str, Any] | str, list[str]] = self.process.receive()
        except TooLargeError as error:
            return str(error), []
        return told
