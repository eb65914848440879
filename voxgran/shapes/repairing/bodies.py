"""The solids that a closed surface bounds: outer shells with their cavities."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers, box_of
from voxgran.geometry.triangles import areas_of
from voxgran.shapes.shells import FLAT, inner_point, shell_labels, without_unused
from voxgran.shapes.winding import winding_numbers


@dataclass(frozen=True, slots=True)
class Shells:
    """Shells of a closed surface."""

    label: Integers  # shell of each face, (m,)
    volume: Floats  # enclosed, negative where faces point inward, (s,)
    within: Booleans  # whether shell s lies in shell t, (s, s)

    @property
    def level(self) -> Integers:
        """In how many others each shell lies."""
        depth: Integers = self.within.sum(axis=1)
        return depth


def shells_of(points: Floats, faces: Integers) -> Shells:
    """Return the shells of a closed surface and which lies in which, whatever the orientation of their faces."""
    label = shell_labels(points, faces)
    count = int(label.max(initial=-1)) + 1
    triangles = (points - np.mean(box_of(points), axis=0)).take(faces, axis=0)
    sixth = linear.einsum("fi,fi->f", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6
    volume = np.bincount(label, weights=sixth, minlength=count).astype(np.float64)
    within = np.zeros((count, count), dtype=np.bool_)
    if count < 2:
        return Shells(label, volume, within)
    parts = [triangles[label == s] for s in range(count)]
    low, high = np.swapaxes([box_of(part.reshape(-1, 3)) for part in parts], 0, 1)
    largest = [int(areas_of(part).argmax()) for part in parts]
    inner = np.array([inner_point(part[k], v) for part, k, v in zip(parts, largest, volume.tolist(), strict=True)])
    for t, part in enumerate(parts):
        reached = np.flatnonzero(((low[t] <= inner) & (inner <= high[t])).all(axis=1))
        reached = reached[reached != t]
        if len(reached):
            within[reached, t] = np.abs(np.round(winding_numbers(part, inner[reached]))) == 1
    return Shells(label, volume, within)


def without_flat(points: Floats, faces: Integers) -> tuple[Integers, int]:
    """Leave out shells that enclose nothing; return the faces that are left and how many shells went."""
    shells = shells_of(points, faces)
    diagonal = float(linear.norm(np.subtract(*box_of(points))))
    flat = np.abs(shells.volume) <= FLAT * diagonal * np.bincount(shells.label, weights=areas_of(points[faces]))
    return faces[~flat[shells.label]], int(flat.sum())


def outward(points: Floats, faces: Integers) -> tuple[Integers, int]:
    """Turn shells over so that outer ones point outward; return the faces and how many shells were turned.

    What lies in a shell that is turned is turned with it where it pointed outward, as in a mesh that is inside out.
    """
    shells = shells_of(points, faces)
    turned = (shells.level == 0) & (shells.volume < 0)
    with_it = (shells.within & turned[None, :]).any(axis=1)
    turned |= with_it & (shells.volume > 0)
    over = turned[shells.label]
    return np.ascontiguousarray(np.where(over[:, None], faces[:, ::-1], faces)), int(turned.sum())


def split(points: Floats, faces: Integers) -> list[tuple[Floats, Integers]]:
    """Return the solids that a closed surface bounds, each with its cavities, the largest first.

    Outer shells point outward and cavities inward.
    """
    shells = shells_of(points, faces)
    solid = np.flatnonzero(shells.volume > 0)
    owner = np.full(len(shells.volume), -1)
    owner[solid] = solid
    for s in np.flatnonzero(shells.volume <= 0):
        around = solid[shells.within[s, solid]]
        if len(around):
            owner[s] = around[shells.volume[around].argmin()]
    whole = np.bincount(owner[owner >= 0], weights=shells.volume[owner >= 0], minlength=len(owner))
    order = solid[np.argsort(-whole[solid], kind="stable")]
    return [without_unused(points, faces[owner[shells.label] == s]) for s in order]
