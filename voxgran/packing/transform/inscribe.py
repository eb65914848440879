"""Shapes inscribed in the spheres of a sphere packing: grains of true shape from spheres that are packed in seconds."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, as_count, as_floats
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import shapes_by_density
from voxgran.geometry.rotation import normalized, random_rotations, rotation_matrices
from voxgran.packing.model import Packing, check_packing
from voxgran.shapes.model import Shape, check_shapes

#: steps of the search for the smallest sphere around a shape
STEPS = 400


@explained(hint="inscribe(packing, shapes)")
def inscribe(
    packing: Packing,
    shapes: Sequence[Shape] | Shape,
    *,
    weights: "ArrayLike | None" = None,
    shape_id: "ArrayLike | None" = None,
    seed: int = 0,
) -> Packing:
    """Inscribe a shape in the bounding sphere of each grain, randomly rotated and as large as it fits.

    Parameters
    ----------
    packing : Packing
        Spheres, in 2D disks, that do not overlap, such as those of ``rsa`` or ``advancing_front``.
    shapes : sequence of Shape or Shape
        Shapes to inscribe, such as hulls of random points.
    weights : (len(shapes),) array_like of float, optional
        Shares of the shapes by number; equal if omitted.
    shape_id : (n,) array_like of int, optional
        Shape of each sphere; drawn at random if omitted. ``range(n)`` gives each sphere its own.
    seed : int
        Seed of the random draws.

    Returns
    -------
    Packing
        As many grains in the same order, each within its sphere: if the spheres do not overlap, the grains do not.
        ``provenance["inscribed"]`` has the solid fraction of the spheres.

    Raises
    ------
    InputError
        If an argument is of another type, there are no shapes, one has another dimension, a share is negative or all
        are 0, or `shape_id` is not n indices of shapes, or grains are fixed.

    Notes
    -----
    The smallest sphere around the vertices of a shape, enlarged by its tessellation error, is mapped to the sphere of
    the grain; the centroid of the grain is therefore not at the center of its sphere. The center of the
    smallest sphere, of radius r, is found within about r / 400.

    Examples
    --------
    >>> import voxgran as vg
    >>> spheres = vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4)), method="advancing_front")
    >>> hulls = [vg.make_shape("convex_polyhedron", seed=k, points=12) for k in range(spheres.count)]
    >>> grains = vg.inscribe(spheres, hulls, shape_id=range(spheres.count))
    >>> vg.verify(grains).ok
    True
    """
    check_packing(packing, "packing")
    packing.refuse_fixed("inscribing shapes")
    # the sizes are those of the spheres, so that other units of the shapes do not matter
    own = (None, packing.unit)
    given = tuple(shape if shape.unit in own else replace(shape, unit=None) for shape in check_shapes(shapes))
    for shape in given:
        if shape.dimension != packing.dimension:
            raise InputError(
                f"shape {shape.name!r} has dimension {shape.dimension}: the packing has {packing.dimension}; use both "
                "of one dimension"
            )
    n, generator = packing.count, stream(as_count(seed, "seed", at_most=None), "inscribed")
    drawn = _drawn(generator, len(given), n, weights)
    turns = _turns(generator, n, packing.dimension)
    spheres = np.array([_sphere_around(shape) for shape in given])
    inscribed = Packing.of(
        given,
        packing.container,
        position=packing.position,
        shape_id=drawn if shape_id is None else shape_id,
        orientation=turns,
        provenance={
            **packing.provenance,
            "shapes": [{"name": shape.name, "key": shape.key} for shape in given],
            "inscribed": {"seed": seed, "solid_fraction_of_spheres": packing.solid_fraction},
        },
        stop_reason=packing.stop_reason,
        unit=packing.unit,
        gravity=packing.gravity,
        contact_gap=packing.contact_gap,
        asked_sizes=packing.asked_sizes,
        grain_id=packing.grain_id,
    )
    # the sphere around a shape of size 1 is mapped to the sphere of the grain
    scale = packing.bounding_radii / spheres[inscribed.shape_id, 3]
    beside = linear.einsum("nij,nj->ni", rotation_matrices(turns), spheres[inscribed.shape_id, :3])
    # each grain keeps the density of its sphere
    shapes, chosen, density = inscribed.shapes, inscribed.shape_id, packing.density
    if isinstance(density, tuple):
        shapes, chosen, density = shapes_by_density(shapes, chosen, packing.densities)
    made = replace(inscribed, shapes=shapes, shape_id=chosen, density=density)
    return replace(made, scale=scale, position=packing.position - scale[:, None] * beside)


def _drawn(generator: np.random.Generator, many: int, n: int, weights: "ArrayLike | None") -> "ArrayLike":
    """Return the shape of each grain, drawn by the shares."""
    if not many:
        raise InputError("shapes is empty: a sphere gets one of them; give at least one")
    share = np.ones(many) if weights is None else as_floats(weights, "weights", shape=(many,))
    if share.min() < 0 or share.sum() <= 0:
        raise InputError(f"weights are {share.tolist()}: shares must not be negative, nor all 0; correct them")
    return generator.choice(many, size=n, p=share / share.sum())


def _turns(generator: np.random.Generator, n: int, dimension: int) -> Floats:
    """Return random orientations, in 2D about z."""
    if dimension == 3:
        return random_rotations(generator, n)
    half = np.pi * generator.random(n)
    return normalized(np.column_stack([libm.cos(half), np.zeros((n, 2)), libm.sin(half)]))


def _sphere_around(shape: Shape) -> tuple[float, float, float, float]:
    """Return center and radius of a sphere around a shape, nearly the smallest (Badoiu & Clarkson 2003)."""
    if shape.is_sphere:
        return 0.0, 0.0, 0.0, shape.bounding_radius
    x, y, z, radius = _enclose(np.ascontiguousarray(shape.vertices), STEPS)
    radius += shape.tessellation_error
    if radius >= shape.bounding_radius:
        return 0.0, 0.0, 0.0, shape.bounding_radius
    return x, y, z, radius


@kernel
def _enclose(corners, steps):  # type: ignore[no-untyped-def]
    """Return center and radius of a sphere around points: the center goes a shrinking share of the way to the farthest
    point at each step.
    """
    x, y, z, radius = 0.0, 0.0, 0.0, 0.0
    for step in range(steps + 1):
        largest, far = -1.0, 0
        for k in range(len(corners)):
            square = (corners[k, 0] - x) ** 2 + (corners[k, 1] - y) ** 2 + (corners[k, 2] - z) ** 2
            if square > largest:
                largest, far = square, k
        radius = math.sqrt(largest)
        if step < steps:
            share = 1.0 / (step + 2)
            x += share * (corners[far, 0] - x)
            y += share * (corners[far, 1] - y)
            z += share * (corners[far, 2] - z)
    return x, y, z, radius
