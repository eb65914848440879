"""A packing as a cloud of points on its grains."""

import numpy as np

from voxgran._base.arrays import as_length
from voxgran.geometry.rotation import rotation_matrices
from voxgran.packing.model import Packing
from voxgran.points.cloud import Cloud
from voxgran.points.sample import sample_surface


def cloud_of_packing(packing: Packing, spacing: float | None = None) -> Cloud:
    """Return points on the surfaces of all grains in the frame of the container, each with the number of its grain.

    `spacing` is the largest one, in the unit of lengths; default: a tenth of the median diameter. A shape is sampled
    once, for its largest grain, so smaller grains are covered more finely.

    Raises
    ------
    InputError
        If `spacing` is not above 0.
    """
    sizes = np.array([packing.shapes[k].diameter for k in packing.shape_id.tolist()]) * packing.scale
    wanted = 0.1 * float(np.median(sizes)) if spacing is None and len(sizes) else spacing
    edge = as_length(1.0 if wanted is None else wanted, "spacing")
    matrices, points, grains = rotation_matrices(packing.orientation), [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    for k, shape in enumerate(packing.shapes):
        mine = np.flatnonzero(packing.shape_id == k)
        if not len(mine):
            continue
        body = np.asarray(sample_surface(shape, spacing=edge / float(packing.scale[mine].max()), seed=k))
        placed = np.einsum("gij,pj->gpi", matrices[mine], body) * packing.scale[mine, None, None]
        points.append((placed + packing.position[mine, None]).reshape(-1, 3))
        grains.append(np.repeat(mine, len(body)))
    order = np.argsort(np.concatenate(grains), kind="stable")
    return Cloud.of(
        np.concatenate(points)[order], grain=np.concatenate(grains)[order], name="packing", unit=packing.unit
    )
