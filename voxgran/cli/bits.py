"""Ten small jobs whose bits are known: whether this machine gives the results of all others."""

import hashlib
import importlib.metadata
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from voxgran.clumps.fit import fit_clump
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.points.sample import sample_surface
from voxgran.shapes.family import make_shape
from voxgran.shapes.sizes import lognormal
from voxgran.voxels.occupy import voxelize

#: versions with which the bits below were made, of what decides them
VERSIONS = {"numpy": "2.4.6", "scipy": "1.17.1", "numba": "0.68.1", "llvmlite": "0.50.0", "manifold3d": "3.5.4"}
#: bits of each job, as `digest` gives them
REFERENCE: dict[str, str] = {
    "lognormal sizes": "2bac7320e61ba502",
    "spherical harmonics": "244858025d0921c5",
    "union of solids": "6ab0f92a39fe9645",
    "points on a surface": "850e0500e3a8c9b2",
    "voxels": "05fb2bf911bb734f",
    "clump": "6d86e9c02b115849",
    "random sequential": "e5620c0ba47e0950",
    "bed of spheres": "25b023819f455c05",
    "bed of polyhedra": "eb619d18fe7f545b",
    "compressed spheres": "92e0e7e3d8fe4f57",
}


def jobs() -> dict[str, Callable[[], Mapping[str, Any]]]:
    """Return the jobs by name; each returns arrays."""
    sphere, rock = make_shape("sphere"), make_shape("convex_polyhedron", seed=3, points=10)
    cell, floor = Box((4, 4, 4), periodic="xyz"), Box((3, 3, 6), periodic="xy")
    return {
        "lognormal sizes": lambda: {"sizes": lognormal(1.0, 0.4).quantile(np.linspace(0.0, 1.0, 999)[1:-1])},
        "spherical harmonics": lambda: {"vertices": make_shape("spherical_harmonics", seed=2).vertices},
        "union of solids": lambda: {"vertices": make_shape("solid_union", seed=2, solids=3).vertices},
        "points on a surface": lambda: {"points": np.asarray(sample_surface(rock, spacing=0.15, seed=1))},
        "voxels": lambda: {"mask": voxelize(make_shape("ellipsoid", aspect=(3, 2, 1)), voxel_size=0.07).mask},
        "clump": lambda: of_clump(fit_clump(rock, max_spheres=8, seed=1)),
        "random sequential": lambda: of_packing(pack(rock, Cylinder(2, 4), "rsa", count=20, seed=1)),
        "bed of spheres": lambda: of_packing(pack(sphere, floor, "gravity", count=20, seed=1)),
        "bed of polyhedra": lambda: of_packing(pack(rock, floor, "gravity", count=8, seed=1)),
        "compressed spheres": lambda: of_packing(pack(sphere, cell, "compress", count=30, seed=1)),
    }


def of_packing(packing: Packing) -> dict[str, Any]:
    """Return the arrays of a packing."""
    arrays = {name: getattr(packing, name) for name in ("shape_id", "scale", "position", "orientation")}
    return {**arrays, "why": np.array(packing.stop_reason)}


def of_clump(clump: Any) -> dict[str, Any]:
    """Return the spheres of a clump."""
    return {"centers": clump.centers, "radii": clump.radii}


def digest(arrays: Mapping[str, Any]) -> str:
    """Return 16 hexadecimal digits that stand for the bits of arrays and for their names."""
    found = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {array.dtype.str} {array.shape}".encode())
        # 0 and -0 are one number
        found.update((array + 0.0 if array.dtype.kind == "f" else array).tobytes())
    return found.hexdigest()[:16]


def differing(names: Iterable[str] = ()) -> list[str]:
    """Return the names of the jobs whose bits differ from the reference; names: of the jobs, by default all."""
    known = jobs()
    with warnings.catch_warnings(action="ignore"):
        return [name for name in names or known if digest(known[name]()) != REFERENCE.get(name)]


def other_versions() -> dict[str, str]:
    """Return the libraries that have another version than those of the reference."""
    found = {name: importlib.metadata.version(name) for name in VERSIONS}
    return {name: version for name, version in found.items() if version != VERSIONS[name]}
