"""Layers of different materials, one after the other: each is packed upon the grains of those below it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from voxgran._base.arrays import as_count, as_positive, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran._base.registry import Parameters
from voxgran._base.scalars import number_of
from voxgran._base.seeds import MOST_SEED, philox_key
from voxgran.containers.model import Container, check_container
from voxgran.packing.beds.expected import surface_level
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.settling.materials import Materials
from voxgran.shapes.model import check_shapes


@explained(hint='pack_layers([{"shapes": sand, "height": 4}, {"shapes": gravel, "count": 50}], box)')
def pack_layers(
    layers: Sequence[Mapping[str, Any]],
    container: Container,
    method: str | Parameters = "gravity",
    *,
    seed: int = 0,
    **arguments: Any,
) -> Packing:
    """Pack layers of different materials, the lowest first.

    Each layer is packed by :func:`pack` with the packing of the layers below as its start. Where grains settle, as by
    ``gravity``, those of the layers below settle again under the new ones and may move a little.

    Parameters
    ----------
    layers : sequence of mapping
        Arguments of :func:`pack` for each layer, at least `shapes`: ``sizes``, ``count``, ``density``, ``orientations``
        and so on. With the method ``gravity`` also ``height``, the thickness of the layer, in place of ``count``.
    container : Container
        What holds the grains. Grains of a layer fall from a column above those below, so that the container is higher
        than all layers.
    method : str or parameter object
        Name of a packing method that packs upon a start, such as ``"gravity"`` or ``"deposition"``, or its parameters.
    seed : int
        The same seed gives the same bits on the same machine and versions.
    **arguments
        Arguments of :func:`pack` for all layers, such as ``friction=0.3`` or ``unit="mm"``. A table of materials names
        those of the shapes of all layers, one after the other.

    Returns
    -------
    Packing
        The grains of all layers, the lowest first. ``provenance["layers"]`` has for each the index of its ``first``
        grain, their ``count``, and the level of its ``surface`` above the lowest point of the container, below which
        95 percent of its grains have their tops.

    Raises
    ------
    InputError
        If there is no layer, one is no mapping, lacks its shapes, has a `start` or both count and height, some have a
        density and others not, a thickness is not above 0, several are made without gravity, or :func:`pack` refuses
        a layer.

    Examples
    --------
    >>> import voxgran as vg
    >>> coarse, fine = {"shapes": vg.shapes.sphere()}, {"shapes": vg.shapes.sphere(diameter=0.7)}
    >>> layers = [{**coarse, "count": 30}, {**fine, "count": 60}]
    >>> bed = vg.pack_layers(layers, vg.Box((4, 4, 12)), friction=0.3)
    >>> [layer["count"] for layer in bed.provenance["layers"]]
    [30, 60]
    """
    check_container(container)
    check_type(layers, (list, tuple), "layers", "a list of mappings, such as [{'shapes': grain, 'count': 100}]")
    if not layers:
        raise InputError("layers is empty: a bed has at least one layer; give one")
    seed, packing = as_count(seed, "seed", at_most=MOST_SEED), None
    first, records = 0, list[dict[str, Any]]()
    asked = [_arguments(layer, number, arguments) for number, layer in enumerate(layers)]
    stated = ["density" in given for given in asked]
    if any(stated) and not all(stated):
        raise InputError(
            f"layer {stated.index(False)} has no density and layer {stated.index(True)} has one: state that of all "
            "layers"
        )
    for number, given in enumerate(asked):
        if "height" in given and packing is not None:
            thickness = as_positive(given["height"], f"height of layer {number}")
            given["height"] = thickness + surface_level(packing)
        friction = given.get("friction")
        if isinstance(friction, Materials) and isinstance(friction.shapes, tuple):
            earlier = 0 if packing is None else len(packing.shapes)
            known = friction.shapes[: earlier + len(check_shapes(given["shapes"]))]
            given["friction"] = replace(friction, shapes=known)
        # each layer has random numbers of its own, the first those of a packing of one layer
        own = int(philox_key(seed, f"layer {number}")[0]) if number else seed
        packing = pack(given.pop("shapes"), container, method, seed=own, start=packing, **given)
        if packing.gravity is None and len(layers) > 1:
            raise InputError(
                "method places grains without gravity: layers would not lie upon each other; give method 'gravity' or "
                "'deposition'"
            )
        records.append({"first": first, "count": packing.count - first})
        first = packing.count
    assert packing is not None
    for record in records:
        record["surface"] = surface_level(packing, record["first"], record["first"] + record["count"])
    return replace(packing, provenance={**packing.provenance, "seed": seed, "layers": records})


def _arguments(layer: Any, number: int, common: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of :func:`pack` for a layer."""
    check_type(layer, Mapping, f"layer {number}", "a mapping of arguments of pack, such as {'shapes': grain}")
    given = {**common, **layer}
    if "shapes" not in given:
        raise InputError(f"layer {number} has no shapes: its grains are drawn from them; give shapes")
    if number_of(given.get("density")) is not None:
        # that of a layer alone, also where the layers below have the density 1
        given["density"] = [given["density"]] * len(check_shapes(given["shapes"]))
    if given.get("height") is not None and given.get("count") is not None:
        raise InputError(
            f"layer {number} has the height {shown(given['height'])} and the count {shown(given['count'])}: either "
            "says how much of it there is; leave one of them out"
        )
    if "start" in given:
        raise InputError(f"layer {number} has a start: its start are the layers below; give them as layers before it")
    return given
