"""Pouring: grains fall below an inlet, in batches of which each comes to rest before the next, or at a rate in time."""

import os
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import as_choice, as_count, as_floats, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, shown, warn
from voxgran._base.files import as_path
from voxgran._base.seeds import MOST_SEED, philox_key
from voxgran.containers.model import Container, check_container
from voxgran.packing.beds.inlet import Inlet
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.model import Shape

#: batches of a count
BATCHES = 20
#: arguments of `pack` that have no meaning for batches
REFUSED = ("solid_fraction", "height", "grains", "recorder")


@explained(hint="pour(sphere, Box((20, 20, 15)), count=400, inlet=Inlet(radius=2), friction=0.5)")
def pour(
    shapes: Sequence[Shape] | Shape,
    container: Container,
    count: int,
    *,
    inlet: Inlet | None = None,
    batch: int | None = None,
    method: Literal["gravity", "deposition"] = "gravity",
    seed: int = 0,
    start: Packing | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    **arguments: Any,
) -> Packing:
    """Pour grains through an inlet: heaps, and containers that are filled at one place.

    With a rate of the inlet, or a fall height, grains arrive one after the other upon the bed, which moves meanwhile,
    and come to rest together at the end. Otherwise they come in batches: those of a batch begin at random in the column
    below the inlet, above the surface of the bed there; they fall, and all grains settle together by the method
    ``gravity``, those of the batches before it too. Each batch comes to rest before the next, as in a slow pour;
    smaller batches are slower ones.

    Parameters
    ----------
    shapes : sequence of Shape or Shape
        Shapes to draw the grains from.
    container : Container
        What holds the grains.
    count : int
        How many grains.
    inlet : Inlet, optional
        Disk or rectangle below which grains begin. Default: a disk of the radius of two median diameters in the middle.
    batch : int, optional
        Grains of a batch. Default: a twentieth of the count, or all of them where they arrive one after the other.
    method : {"gravity", "deposition"}
        How grains move: with all others, or each alone upon grains that do not move any more, which takes no rate.
    seed : int
        The same seed gives the same bits on the same machine and versions.
    start : Packing, optional
        Grains upon which others are poured, as in :func:`pack`; fixed ones among them stay.
    checkpoint : path-like, optional
        File for checkpoints of the first batch, as in :func:`pack`; those of later ones have its name with ``.1``,
        ``.2`` and so on.
    resume : bool
        Whether to go on from these files where they are there.
    **arguments
        Arguments of :func:`pack` for the method, such as ``friction=0.3``, ``fall_height=5``, ``sizes``, ``weights``,
        ``obstacles`` or ``unit="mm"``. A time limit is that of each batch.

    Returns
    -------
    Packing
        The grains, in the order in which they were poured, after those of a start. ``provenance["batches"]`` has the
        number of grains of each batch; the stop reason is ``full`` where no more have room below the inlet.

    Raises
    ------
    InputError
        If an argument is of another type, has no meaning for pouring (a solid fraction, a height, a list of grains, a
        recorder), batches are asked for where grains arrive one after the other, the inlet is narrower than a grain,
        reaches beyond the container, lies within walls or above the container, or :func:`pack` refuses a batch.

    Warns
    -----
    PackingWarning
        If the container is full below the inlet before all grains are poured.

    Examples
    --------
    >>> import voxgran as vg
    >>> heap = vg.pour(vg.make_shape("disk"), vg.Rectangle((16, 8)), 30, batch=10, friction=0.5)
    >>> heap.count, heap.provenance["batches"]
    (30, [10, 10, 10])
    """
    check_container(container)
    inlet = Inlet() if inlet is None else inlet
    check_type(inlet, Inlet, "inlet", "an Inlet, such as Inlet(radius=2)")
    as_choice(method, "method", ("gravity", "deposition"))
    count, seed = as_count(count, "count", at_least=1), as_count(seed, "seed", at_most=MOST_SEED)
    if wrong := [name for name in REFUSED if name in arguments]:
        raise InputError(f"{wrong[0]} is given: grains are poured by a count alone; leave it out")
    singly = method != "gravity" or inlet.rate is not None or arguments.get("fall_height") is not None
    if singly and batch is not None:
        raise InputError(
            f"batch is {shown(batch)}: by deposition, at a rate or from a fall_height grains arrive one after the "
            "other; leave it out"
        )
    size = count if singly else -(-count // BATCHES) if batch is None else as_count(batch, "batch", at_least=1)
    path = None if checkpoint is None else as_path(checkpoint)
    packing, batches, drawn, said = start, list[int](), shapes, set[str]()
    while (poured := sum(batches)) < count and (not batches or batches[-1]):
        own = int(philox_key(seed, f"batch {len(batches)}")[0]) if batches else seed
        asked: dict[str, Any] = {"count": min(size, count - poured), "seed": own, "start": packing, "inlet": inlet}
        if path is not None:
            own_path = path.with_name(path.name + (f".{len(batches)}" if batches else ""))
            asked |= {"checkpoint": own_path, "resume": resume}
        with warnings.catch_warnings(record=True, action="always") as caught:
            packing = pack(drawn, container, method, **asked, **arguments)
        # each is said once, and that grains are missing at the end
        for text, category in {str(one.message): one.category for one in caught}.items():
            if text not in said and " grains were placed " not in text:
                said.add(text)
                warn(text, category)
        if not batches:
            before = sum(one.count for one in (start, arguments.get("obstacles")) if one is not None)
            arguments, drawn = _of_later_batches(packing, shapes, arguments), ()
        batches.append(packing.count - before - poured)
        if singly or packing.stop_reason == "interrupted":
            break
    assert packing is not None
    poured = sum(batches)
    missed = {**packing.provenance["missed"], "count": count - poured}
    if poured < count and packing.stop_reason != "interrupted":
        warn(
            f"{poured} of {count} grains were poured: the container is full below the inlet; ask for less, make the "
            "inlet wider or move it, or give a higher container",
            PackingWarning,
        )
    return replace(packing, provenance={**packing.provenance, "seed": seed, "batches": batches, "missed": missed})


def _of_later_batches(packing: Packing, shapes: Sequence[Shape] | Shape, given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of the batches after the first, whose shapes are those of its packing."""
    many = 1 if isinstance(shapes, Shape) else len(shapes)
    weights = np.zeros(len(packing.shapes))
    stated = given.get("weights")
    weights[len(weights) - many :] = 1.0 if stated is None else as_floats(stated, "weights", shape=(many,))
    return {name: value for name, value in given.items() if name not in ("obstacles", "density")} | {"weights": weights}
