"""Fabric: fabric tensors, anisotropy and roses of contact normals, branch vectors and long axes of grains.

Contacts are the pairs of grains at the contact gap of the packing, each once per periodic image; walls do not count. A
branch vector leads from the centroid of a grain to that of its neighbour, or of the periodic image that it touches. The
tensors of branch vectors are those of their directions, and those weighted with their squared lengths, which are the
moments of the vectors over their trace (Satake 1982; Kanatani 1984, doi:10.1016/0020-7225(84)90055-7). The long
axis of a grain is the principal axis of its smallest moment of inertia; grains without a distinct one, such as spheres
and cubes, have none.

The orientation tensor is the mean of n n of these axes, or of those that a distribution of orientations was asked for,
beside the tensor of that distribution.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.containers.model import periods_of
from voxgran.geometry.orientation_laws.directional import Random
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.geometry.orientations import make_orientations
from voxgran.geometry.periods import along_edges
from voxgran.measures.directions import Fabric, Rose, fabric_of, rose_of
from voxgran.measures.model import Groups, Measure, dataset, variable
from voxgran.measures.region import gravity_of
from voxgran.measures.registered.coordination import touching_contacts
from voxgran.packing.model import Packing
from voxgran.shapes.describing.extents import body_axes

#: the sets of vectors that are measured
NORMALS, BRANCHES, WEIGHTED, AXES = "contact_normals", "branch_vectors", "weighted_branch_vectors", "long_axes"


@dataclass(frozen=True, eq=False)
class Vectors:
    """A set of vectors in a packing."""

    way: Floats  # (m, 3) of any length
    place: Floats  # (m, 3) where they are
    weight: Floats | None = None  # (m,); None where all count alike


def fabric_vectors(packing: Packing) -> dict[str, Vectors]:
    """Return all sets of vectors."""
    contacts = touching_contacts(packing)
    shift = linear.matmul(contacts.image, periods_of(packing.container))
    branch = packing.position[contacts.j] + shift - packing.position[contacts.i]
    # relative lengths, whose squares neither overflow nor vanish
    length = linear.norm(branch / max(float(np.abs(branch).max(initial=0.0)), 1e-300), axis=1)
    axes, grains = long_axes(packing)
    return {
        NORMALS: Vectors(contacts.normal, contacts.point),
        BRANCHES: Vectors(branch, contacts.point),
        WEIGHTED: Vectors(branch, contacts.point, np.square(length)),
        AXES: Vectors(axes, packing.position[grains]),
    }


def fabric(packing: Packing, vectors: Vectors) -> Fabric:
    """Return the fabric tensors of vectors of a packing, with the scatter that they have at the longest waves."""
    d = packing.dimension
    # extremes along rows of memory are found faster than along its columns
    place = np.ascontiguousarray(vectors.place[:, :d].T)
    periods = periods_of(packing.container)
    length = periods.diagonal()[:d]
    if place.size:
        # walls and the free surface end the sample
        length = np.where(length > 0.0, length, np.ptp(place, axis=1))
    origin = place.min(axis=1, initial=np.inf)
    turns = None
    if (length > 0.0).all():
        turns = along_edges(vectors.place - np.append(origin, 0.0)[:3], periods)[:, :d] / length
    return fabric_of(vectors.way, vectors.weight, dimension=d, turns=turns)


def long_axes(packing: Packing) -> tuple[Floats, Integers]:
    """Return the unit vectors along the long axes of the grains that have a distinct one, (m, 3), and these grains."""
    return _directions(packing, Random())


def _directions(packing: Packing, law: OrientationLaw) -> tuple[Floats, Integers]:
    """Return the unit vectors along the axes of the grains that a distribution of orientations is of, and the grains
    that have one.
    """
    axes = body_axes(packing.shapes, law)
    distinct: Booleans = np.asarray(axes.any(axis=1), dtype=np.bool_)
    grains = np.flatnonzero(distinct[packing.shape_id])
    return linear.einsum("nij,nj->ni", packing.matrices[grains], axes[packing.shape_id[grains]]), grains


def _orientations(packing: Packing) -> dict[str, Any]:
    """Return the variables of the orientation tensor: as placed, its standard error, and as it was asked for."""
    asked = (packing.provenance.get("asked") or {}).get("orientations")
    law = Random() if asked is None or asked["kind"] == "given" else make_orientations(asked)
    d, tensor = packing.dimension, ("i", "j")
    ways, grains = _directions(packing, law)
    each = ways[:, :d, None] * ways[:, None, :d]
    empty = np.full((d, d), np.nan)
    error = each.std(axis=0, ddof=1) / math.sqrt(len(grains)) if len(grains) > 1 else empty
    made = {
        "orientation_tensor": variable(
            tensor, each.mean(axis=0) if len(grains) else empty, "1", "orientation tensor: mean of n n of body axes"
        ),
        "orientation_tensor_error": variable(tensor, error, "1", "its standard error, for independent orientations"),
    }
    if asked is not None and asked["kind"] != "given":
        wanted = law.moment(dimension=d)
        made["orientation_tensor_asked"] = variable(tensor, wanted, "1", "the orientation tensor that was asked for")
    return made


def _compute(packing: Packing) -> Groups:
    """Return tensors, anisotropies and roses of all sets of vectors."""
    sets, d = fabric_vectors(packing), packing.dimension
    gravity = gravity_of(packing)
    pole = 2 if gravity is None else gravity[0]
    fabrics = [fabric(packing, given) for given in sets.values()]
    roses = [rose_of(given.way, given.weight, dimension=d, pole=pole) for given in sets.values()]
    labels = {"vector": variable(("vector",), np.array(list(sets)), "1", "set of vectors")}
    tensors = {**_tensors(fabrics), **_anisotropies(fabrics), **_orientations(packing)}
    found = dataset({**tensors, **_roses(roses, d)}, labels)
    found.attrs["pole"] = "xyz"[pole] if d == 3 else "none"
    normals = fabrics[0].second_order
    told = "anisotropy of the contact normals, of second order and without bias"
    error = normals.error if np.isfinite(normals.error) else None
    return {
        "/": dataset({"contact_anisotropy": variable((), normals.unbiased, "1", told, error=error)}),
        "/fabric": found,
    }


def _tensors(fabrics: list[Fabric]) -> dict[str, Any]:
    """Return the variables of the tensors; principal directions are rows, the largest value first."""
    row = ("vector",)
    second = np.array([one.second for one in fabrics])
    values, ways = np.full(second.shape[:2], np.nan), np.full(second.shape, np.nan)
    for k, tensor in enumerate(second):
        if np.isfinite(tensor).all():
            rising, columns = linear.eigh(tensor)
            values[k], ways[k] = rising[::-1], columns.T[::-1]
    return {
        "count": variable(row, [one.count for one in fabrics], "1", "number of vectors"),
        "second_order": variable((*row, "i", "j"), second, "1", "fabric tensor of second order: mean of n n"),
        "fourth_order": variable(
            (*row, "i", "j", "k", "l"),
            np.array([one.fourth for one in fabrics]),
            "1",
            "fabric tensor of fourth order: mean of n n n n",
        ),
        "principal_value": variable(
            (*row, "principal"), values, "1", "principal values of the second order, descending"
        ),
        "principal_direction": variable((*row, "principal", "i"), ways, "1", "unit vectors along the principal axes"),
    }


def _anisotropies(fabrics: list[Fabric]) -> dict[str, Any]:
    """Return the variables of the anisotropies."""
    made = {}
    for name, order in (("second", "second_order"), ("fourth", "fourth_order")):
        all_of = [getattr(one, order) for one in fabrics]
        label = f"anisotropy of {name} order"
        for part, word in (("plain", ", as sampled"), ("unbiased", ", without bias"), ("error", ": standard error")):
            title = f"{order}_anisotropy" + {"plain": "_as_sampled", "unbiased": "", "error": "_error"}[part]
            values = [getattr(one, part) for one in all_of]
            made[title] = variable(("vector",), values, "1", label + word)
    return made


def _roses(roses: list[Rose], dimension: int) -> dict[str, Any]:
    """Return the variables of the roses."""
    cells, row = roses[0].cells, ("cell",)
    density, error = (np.array([getattr(one, name) for one in roses]) for name in ("density", "error"))
    made = {
        "density": variable(("vector", *row), density, "1", "density of directions, relative to an isotropic one"),
        "density_error": variable(("vector", *row), error, "1", "standard error of the density"),
        "azimuth_from": variable(row, cells[:, 1, 0], "1", "lowest azimuth of the cell, in radians"),
        "azimuth_to": variable(row, cells[:, 1, 1], "1", "highest azimuth of the cell, in radians"),
    }
    if dimension == 3:
        made |= {
            "polar_from": variable(row, cells[:, 0, 0], "1", "lowest angle of the cell from the pole, in radians"),
            "polar_to": variable(row, cells[:, 0, 1], "1", "highest angle of the cell from the pole, in radians"),
        }
    return made


registration = Measure(
    summary="fabric tensors, anisotropy and roses of contact normals, branch vectors and long axes",
    groups=("/", "/fabric"),
    compute=_compute,
    tilted=True,
)
