"""Common volume of overlapping meshes inside a box, from exact unions (manifold3d).

Overlapping grains form clusters; the common volume of a cluster is the sum of the volumes of its members minus the
volume of their union, all cut to the box. In 2D outlines become prisms of height 1.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran.containers.model import periods_of
from voxgran.lattice.label import components
from voxgran.measures.slices import cut_mesh
from voxgran.packing.model import Packing
from voxgran.shapes.boolean import united

#: a grain and its periodic image
Copy = tuple[int, tuple[int, int, int]]


def overlap_volume(
    packing: Packing,
    pairs: tuple[Integers, Integers, Integers],
    present: tuple[Integers, Integers],
    *,
    lower: Floats,
    upper: Floats,
) -> float:
    """Return the volume (in 2D area) inside a box that is counted more than once in the sum over the grains.

    `pairs` are the overlapping grains (i, j, image), and `present` the grains (m,) that reach into the box with the
    image (m, 3) of each. The box is infinite on open sides. Grains that are not closed surfaces are refused.
    """
    clusters = _clusters(pairs, present) if pairs[0].size else []
    return sum(_shared(packing, cluster, lower, upper) for cluster in clusters)


def _clusters(pairs: tuple[Integers, Integers, Integers], present: tuple[Integers, Integers]) -> list[list[Copy]]:
    """Return the connected sets of copies that overlap."""
    copies: list[Copy] = [(int(g), (int(a), int(b), int(c))) for g, (a, b, c) in zip(*present, strict=True)]
    place = {copy: k for k, copy in enumerate(copies)}
    turns = defaultdict(list)
    for grain, turn in copies:
        turns[grain].append(turn)
    one, two = [], []
    for i, j, (a, b, c) in zip(*(array.tolist() for array in pairs), strict=True):
        for turn in turns[i]:
            partner = place.get((j, (turn[0] + a, turn[1] + b, turn[2] + c)))
            if partner is not None:
                one.append(place[i, turn])
                two.append(partner)
    label = components(len(copies), np.array(one, dtype=np.int64), np.array(two, dtype=np.int64))
    members = np.unique(one + two).astype(np.int64)
    return [[copies[m] for m in members[label[members] == k]] for k in np.unique(label[members])]


def _shared(packing: Packing, cluster: Sequence[Copy], lower: Floats, upper: Floats) -> float:
    """Return the volume of the members of a cluster inside the box, minus that of their union."""
    periods = periods_of(packing.container)
    corners = [packing.world_vertices(grain) + linear.matmul(np.array(turn), periods) for grain, turn in cluster]
    faces = [packing.shapes[packing.shape_id[grain]].faces for grain, _ in cluster]
    # manifold3d needs lengths of the order of 1 about the origin; a power of two does not change the digits
    origin = corners[0].mean(axis=0)
    size = 2.0 ** np.ceil(libm.log2(float(packing.bounding_radii[[grain for grain, _ in cluster]].max())))
    solids = [((points - origin) / size, triangles) for points, triangles in zip(corners, faces, strict=True)]
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    low[: len(lower)], high[: len(upper)] = (lower - origin[: len(lower)]) / size, (upper - origin[: len(upper)]) / size
    if packing.dimension == 2:
        solids = [_prism(*solid) for solid in solids]
    pose = np.eye(3)[None], np.zeros((1, 3))
    parts = [cut_mesh(p, f, *pose, lower=low, upper=high)[0] for p, f in solids]
    points, triangles = united(solids)
    union = cut_mesh(points, triangles, *pose, lower=low, upper=high)[0]
    return max(0.0, float(sum(parts) - union)) * float(size) ** packing.dimension


def _prism(vertices: Floats, faces: Integers) -> tuple[Floats, Integers]:
    """Return the prism of height 1 over an outline."""
    n = len(vertices)
    around = np.arange(n)
    after = np.roll(around, -1)
    one, two = np.column_stack([around, after, after + n]), np.column_stack([around, after + n, around + n])
    solid = np.concatenate([faces[:, ::-1], faces + n, one, two])
    half = np.array([0.0, 0.0, 0.5])
    return np.concatenate([vertices - half, vertices + half]), solid
