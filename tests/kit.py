"""What several test files need: tasks of packing methods, lattices of points, meshes, and the reference values."""

import tomllib
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from voxgran.packing.driver import Drive, drive
from voxgran.packing.pack import prepare_task
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import unit_box

REFERENCES = Path(__file__).parent / "reference" / "references.toml"


def references(table):
    """Return a table of published values; the file says where each comes from."""
    return tomllib.loads(REFERENCES.read_text())[table]


def task_of(method, shapes, container, *, count=None, sizes=None, seed=0, start=None, **parameters):
    """Return the task of packing so many grains, ready to run, with parameters of the method."""
    return prepare_task(
        shapes,
        container,
        method=method,
        count=count,
        solid_fraction=None,
        sizes=sizes,
        weights=None,
        weights_by="number",
        seed=seed,
        start=start,
        parameters=parameters,
    )


def run(task, chunk=None):
    """Run a task to its end; return the state and the packing."""
    state = drive(task.method, task.problem, Drive(chunk=chunk))
    return state, task.method.finish(task.problem, state)


def lattice(*counts):
    """Return the centers of unit cells, the last axis fastest: (n, 3) for three counts."""
    axes = [np.arange(count) + 0.5 for count in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(counts))


def mesh_box(lengths):
    """Return a box as a triangulated shape."""
    vertices, faces, _ = unit_box()
    return Shape.from_mesh(vertices * np.array(lengths), faces, name="box")


def fixed_shape(vertices, faces):
    """Return a shape that stays where it is: its frame is that of the lattice."""
    return Shape(Mesh(np.ascontiguousarray(vertices, dtype=float), np.ascontiguousarray(faces)), "body")


def hull(points):
    """Return vertices and outward faces of a convex hull, and its half-spaces."""
    found = ConvexHull(points)
    corners = points[found.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normals, found.equations[:, :3]) < 0
    faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
    return points, faces.astype(np.int64), found.equations
