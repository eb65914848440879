"""A file that becomes a shape of a scene: a mesh, with its diagnosis and repair, or a distribution of shapes."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from voxgran.scene.entries import MANY
from voxgran.shapes.formats.mesh_files import read_surface
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.repairing.diagnose import diagnose
from voxgran.shapes.repairing.repair import repaired


def entry_of_file(path: Path) -> tuple[dict[str, Any], str]:
    """Return the keys of a [[shape]] that is read from a file, and what was found in it, in sentences.

    Raises
    ------
    VoxgranError
        If it holds neither a mesh that can be mended nor a learned distribution of shapes.
    """
    if path.suffix.lower() == ".nc":
        model = ShapeModel.load(path)
        return {"family": "learned", "model": str(path), "count": MANY}, f"{path.name}: {model}"
    points, faces = read_surface(path)
    found = diagnose(points, faces)
    made = repaired(points, faces, name=path.stem)
    counts = ", ".join(f"{one.name.replace('_', ' ')} {getattr(found, one.name)}" for one in fields(found))
    done = "; ".join(made.sentences) or "nothing has to be mended"
    mended = {"repair": True} if made.sentences else {}
    return {"file": str(path), **mended}, f"{path.name}: {counts}\n{done}"
