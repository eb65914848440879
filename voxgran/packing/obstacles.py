"""Obstacles: fixed grains that stand in the container, around which methods pack."""

from dataclasses import replace
from typing import Any

import numpy as np

from voxgran._base.errors import InputError, numbered
from voxgran._base.units import NO_UNIT, as_unit
from voxgran.contacts.assembly import Assembly, Density
from voxgran.contacts.inside import Occupied
from voxgran.contacts.verify import verify
from voxgran.containers.model import Container
from voxgran.packing.draw import Request
from voxgran.packing.method import PackingMethod, method_registry
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import check_start, joined_fixed, joined_ids, number_fixed


def unit_of(request: Request) -> str | None:
    """Return the unit of lengths that is asked for, or else that of the start, or of the obstacles.

    Raises
    ------
    InputError
        If the obstacles are no packing, or of another dimension than the container.
    UnknownNameError
        If it is unknown.
    """
    unit = request.unit
    if request.obstacles is not None:
        check_packing(request.obstacles, "obstacles")
        check_start(request.obstacles, request.container.dimension, "obstacles")
    for held in (request.start, request.obstacles):
        unit = held.unit if held is not None and as_unit(unit) == NO_UNIT else unit
    return unit


def start_with(obstacles: Packing, start: Packing | None, container: Container, unit: str) -> Packing:
    """Return obstacles as fixed grains, followed by the grains of a start, as the start of a packing in a container.

    Raises
    ------
    InputError
        If they overlap each other, reach beyond a wall, or fill the container.
    """
    one = obstacles if obstacles.unit == NO_UNIT else obstacles.to_unit(unit)
    poses = (one.shapes, one.shape_id, one.scale, one.position, one.orientation)
    proof = verify(Assembly(*poses, container))
    wrong = sorted({item.grain for item in proof.escapes} | {pair.j for pair in proof.pairs})
    if wrong:
        raise InputError(
            f"{numbered('grain', np.array(wrong))} of obstacles overlap others or reach beyond a wall: "
            "move or cut them, or make one shape of those that overlap"
        )
    if one.volumes.sum() >= container.volume:
        raise InputError(
            f"obstacles have {one.volumes.sum():.4g} of the volume {container.volume:.4g} of the container: no room is "
            "left; make them smaller or the container larger"
        )
    fixed = replace(one, container=container, fixed=np.ones(one.count, dtype=np.bool_))
    if start is None:
        return fixed
    parts = [(fixed.grain_id, fixed.count), (start.grain_id, start.count)]
    return Packing.of(
        (*fixed.shapes, *start.shapes),
        container,
        position=np.concatenate([fixed.position, start.position]),
        scale=np.concatenate([fixed.scale, start.scale]),
        shape_id=np.concatenate([fixed.shape_id, start.shape_id + len(fixed.shapes)]),
        orientation=np.concatenate([fixed.orientation, start.orientation]),
        provenance=start.provenance,
        unit=unit,
        gravity=None,
        fixed=joined_fixed(fixed, start),
        grain_id=joined_ids(*parts),
    )


def refuse_no_spheres(problem: Problem, method: str) -> None:
    """Refuse fixed grains that are no spheres, where a method packs spheres around spheres.

    Raises
    ------
    InputError
        If one of them is of another shape.
    """
    if any(not problem.shapes[k].is_sphere for k in problem.shape_id[: problem.fixed]):
        raise InputError(
            f"obstacles are not all spheres: method {method!r} packs spheres around spheres; give method 'rsa', "
            "'gravity' or 'digital'"
        )


def with_density_of(obstacles: Packing | None, density: Density) -> Density:
    """Return densities of shapes after those of the shapes of obstacles, on which nothing depends."""
    several = obstacles is not None and isinstance(density, tuple)
    return (density[0],) * len(obstacles.shapes) + density if several else density  # type: ignore[union-attr,index]


def around_obstacles(
    method: PackingMethod, start: Packing | None, container: Container
) -> tuple[PackingMethod, Packing | None, Container]:
    """Return a method as it packs around the fixed grains of a start, the start with these first, and their container
    without their volume.

    Raises
    ------
    InputError
        If it does not pack around obstacles.
    """
    if start is None or start.fixed is None:
        return method, start, container
    start = start[np.argsort(start.movable, kind="stable")]
    many = number_fixed(start)
    room = Occupied(container, start[:many], 0.0)
    if method.obstacles == "refused":
        registry = method_registry()
        others = [name for name in registry.names() if registry.get(name).obstacles != "refused"]
        raise InputError(
            f"{many} grains are fixed, and method {method.name!r} {method.no_obstacles}: give a method that "
            f"packs around obstacles, one of {', '.join(others)}"
        )
    if method.obstacles == "placed":
        return method, start, room

    def finish(problem: Problem, state: Any) -> Packing:
        return problem.beside_fixed(method.finish(problem.apart, state))

    around = replace(
        method,
        prepare=lambda problem: method.prepare(problem.apart),
        advance=lambda problem, state, attempts: method.advance(problem.apart, state, attempts),
        finish=finish,
        cost=lambda problem: method.cost(problem.apart),
    )
    return around, start, room
