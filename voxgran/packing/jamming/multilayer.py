"""Undercompaction: layers of grains are compacted one by one, to a bed of one porosity at all heights.

Each layer appears at random points between the layers before it and a plate, and grains push each other apart until
none overlap. Layers below are compacted further by those above. So that all end at the same porosity, the mean void
ratio of the first layers is higher than that of the bed, and falls with each layer to the one that is asked for: after
layer k of n it is e (1 + u (n - k) / (n - 1)) with the void ratio e of the bed and the undercompaction u of the first
layer (Jiang, Konrad & Leroueil 2003; the linear rule is that of Ladd 1978). The default leaves the smallest slope at
solid fractions from 0.5 to 0.62.

All sizes are multiplied by one factor, which meets the solid fraction exactly, also together with a count.

References
----------
Jiang, Konrad & Leroueil 2003, An efficient technique for generating homogeneous specimens for DEM studies, Computers
and Geotechnics 30, 579-597, doi:10.1016/S0266-352X(03)00064-8.
Ladd 1978, Preparing test specimens using undercompaction, Geotechnical Testing Journal 1, 16-23.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.checkpoint import MOST, Declared, Held
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.containers.gravity import as_down, usual_axis
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container, boundary_of
from voxgran.packing.jamming.expand import finish as expanded
from voxgran.packing.jamming.expected import reachable
from voxgran.packing.jamming.method import CompressState, advance, as_many, cost_of
from voxgran.packing.jamming.spheres import SoftSpheres
from voxgran.packing.method import PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem

#: how much below the solid fraction at which the grains jam a bed is if nothing is asked for
LOOSER = 0.05
#: arrays of the spheres up to the present layer
OF_LAYER = ("spheres", "velocity", "force", "listed")


@parameter_class
class Multilayer:
    """Parameters of layers that are compacted one by one.

    Parameters
    ----------
    layers
        number of layers, of equally many grains.
    undercompaction
        void ratio of the first layer when it is compacted over that of the bed, less 1; the last one has 0.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> import voxgran as vg
    >>> method = vg.methods.Multilayer(layers=2)
    >>> column = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 8)), method, solid_fraction=0.5)
    >>> round(column.solid_fraction, 2)
    0.5
    """

    layers: int = parameter(5, at_least=1, at_most=1000)
    undercompaction: float = parameter(0.1, at_least=0.0, at_most=5.0)


def prepare(problem: Problem) -> CompressState:
    """Return the state in which the grains of the first layer are at random points.

    Raises
    ------
    InputError
        If the container is not a box or a rectangle with a floor and a lid, a shape is not a
        sphere or a disk, or the grains would be denser than they jam.
    """
    container, up = problem.container, problem.dimension - 1
    if not boundary_of(container).is_flat or container.periodic[up]:
        raise InputError(
            f"container is {container.kind!r}: layers lie on the floor of a box or a rectangle, below a plate; give "
            f"one that is not periodic along {'xyz'[up]}, or method='expand'"
        )
    other = [shape.name for shape in problem.shapes if not shape.is_sphere]
    if other:
        raise InputError(
            f"shape {other[0]!r} is no sphere: this method packs spheres and disks; give method='gravity' or 'digital'"
        )
    n, most = _with_room(problem), reachable(problem.diameter, problem.dimension) if problem.count else 1.0
    filled = float(problem.volumes[:n].sum()) / container.volume
    if filled > most:
        raise InputError(
            f"the grains have {filled:.4g} times the volume of the container, and jam at about {most:.3g}: ask for "
            "fewer or smaller ones, or a lower solid fraction"
        )
    compressor = LayeredSpheres(*_layers(problem, n), seed=problem.seed)
    return CompressState(compressor, total=compressor.most_steps, stop_reason="count" if compressor.ended else "")


def _with_room(problem: Problem) -> int:
    """Return how many grains there are: a count, or as many as lie a little looser than they jam."""
    if problem.target or not problem.count:
        return problem.count
    return as_many(problem, (reachable(problem.diameter, problem.dimension) - LOOSER) * problem.container.volume)


def _layers(problem: Problem, n: int) -> tuple[Assembly, Floats, Integers]:
    """Return the first n grains, the height of the plate after each layer, and the number of grains up to it."""
    settings: Multilayer = problem.parameters
    many = max(1, min(settings.layers, n))
    counts = (n * np.arange(1, many + 1)) // many
    total = float(problem.volumes[:n].sum())
    lower, upper = problem.container.bounds
    height = float((upper - lower)[problem.dimension - 1])
    heights = np.full(many, height)
    if n:
        share = np.cumsum(problem.volumes[:n])[counts - 1] / total
        void = problem.container.volume / total - 1.0
        left = np.arange(many - 1, -1, -1) / max(many - 1, 1)
        heights = share * height * (1.0 + void * (1.0 + settings.undercompaction * left)) / (1.0 + void)
    # rounding would leave the last layer a plate that is not the lid
    heights[-1] = height
    assembly = Assembly.of(
        problem.shapes,
        problem.container,
        position=np.zeros((n, 3)),
        scale=problem.diameter[:n],
        shape_id=problem.shape_id[:n],
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
    )
    return assembly, np.minimum(heights, height), counts.astype(np.int64)


def finish(problem: Problem, state: CompressState) -> Packing:
    """Return the packing of the layers that are there."""
    down = as_down(usual_axis(problem.container), problem.container)
    return expanded(problem, state, gravity=down)


registration = PackingMethod(
    summary="layers are compacted one by one to a bed of one solid fraction at all heights",
    source="Jiang, Konrad & Leroueil 2003, doi:10.1016/S0266-352X(03)00064-8",
    parameters=Multilayer,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=lambda problem: cost_of(_with_room(problem)),
    dimensions=(2, 3),
    sizing="scaled",
    keeps_sizes=True,
    no_start="makes layers of new grains only",
    no_obstacles="finds the heights of its layers from the volumes of their own grains",
)


class LayeredSpheres:
    """Compressor of spheres and disks in layers: see :class:`voxgran.packing.jamming.method.Compressor`.

    Parameters
    ----------
    assembly : Assembly
        All grains, in the order of the layers; only their sizes are used.
    heights : (k,) ndarray of float
        Height of the plate above the floor after each layer; the last one is that of the container.
    counts : (k,) ndarray of int
        Number of grains up to each layer.
    seed : int
        Seed of the points at which grains appear.
    """

    def __init__(self, assembly: Assembly, heights: Floats, counts: Integers, *, seed: int) -> None:
        self.assembly, self.heights, self.counts, self.seed = assembly, heights, counts, seed
        self.layer, self.earlier_steps = 0, 0
        self.position = np.zeros((assembly.count, 3))
        self._scatter()
        self.current = self._compressor()
        self.most_steps = self.current.most_steps * len(heights)

    def _scatter(self) -> None:
        """Put the grains of the present layer at random points between the layers before it and the plate."""
        begin, end = self._layer_start(), int(self.counts[self.layer])
        lower, upper = (np.array(corner) for corner in self.assembly.container.bounds)
        up = self.assembly.dimension - 1
        floor = lower[up]
        lower[up] = floor + (self.heights[self.layer - 1] if self.layer else 0.0)
        upper[up] = floor + self.heights[self.layer]
        generator = stream(self.seed, "points", self.layer)
        self.position[begin:end] = lower + generator.random((end - begin, 3)) * (upper - lower)

    def _layer_start(self) -> int:
        """Return the number of grains of all layers before the present one."""
        return int(self.counts[self.layer - 1]) if self.layer else 0

    def _compressor(self) -> SoftSpheres:
        """Return the compressor of all grains up to the present layer, below the plate."""
        whole, n = self.assembly, int(self.counts[self.layer])
        grains = Assembly.of(
            whole.shapes,
            _below(whole.container, float(self.heights[self.layer])),
            position=self.position[:n],
            scale=whole.scale[:n],
            shape_id=whole.shape_id[:n],
            orientation=whole.orientation[:n],
        )
        return SoftSpheres(grains, jam=False, seed=self.seed)

    @property
    def ended(self) -> bool:
        """Whether the last layer is compacted."""
        return self.current.ended and self.layer == len(self.heights) - 1

    @property
    def done_steps(self) -> int:
        """Steps made."""
        return self.earlier_steps + self.current.done_steps

    @property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Arrays of the state."""
        return {**self.current.arrays, "position": self.position}

    @property
    def counters(self) -> Mapping[str, int]:
        """Whole numbers of the state."""
        return {**self.current.counters, "layer": self.layer, "earlier_steps": self.earlier_steps}

    @property
    def declared(self) -> Declared:
        """What a checkpoint may hold; the spheres are those up to its layer."""
        lower, upper = self.assembly.container.bounds
        wide = upper - lower
        layer, earlier = Held(0, len(self.heights) - 1), Held(0, MOST)
        rows = {name: replace(self.current.declared.get(name, Held()), rows="layer") for name in OF_LAYER}
        own = {"position": Held(np.minimum(lower - wide, 0.0), upper + wide), "layer": layer, "earlier_steps": earlier}
        return {**self.current.declared, **rows, **own}

    def rule(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
        """Return whether what a checkpoint holds goes together."""
        return len(arrays["spheres"]) == self.counts[counters["layer"]]

    def restore(self, arrays: Mapping[str, NDArray[Any]], counters: Mapping[str, int]) -> None:
        """Take over the state of a checkpoint."""
        self.layer, self.earlier_steps = int(counters["layer"]), int(counters["earlier_steps"])
        self.position = np.array(arrays["position"], dtype=np.float64)
        self.current = self._compressor()
        self.current.restore(arrays, counters)

    def step(self) -> None:
        """Make one step, or begin the next layer where one is compacted."""
        if not self.current.ended:
            self.current.step()
            return
        self.position[: self.counts[self.layer]] = self.current.poses()[0]
        self.earlier_steps += self.current.done_steps
        self.layer += 1
        self._scatter()
        self.current = self._compressor()

    @property
    def factor(self) -> float:
        """Common factor on the sizes at which nothing overlaps."""
        return self.current.factor

    @property
    def report(self) -> dict[str, Any]:
        """Numbers of the run, and the heights of the plate over that of the container."""
        return {**self.current.report, "layer_heights": (self.heights / self.heights[-1]).tolist()}

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions (n, 3) and orientations (n, 4) of the grains up to the present layer."""
        return self.current.poses()


def _below(container: Container, height: float) -> Container:
    """Return the part of a box or a rectangle up to a height."""
    lower, upper = container.bounds
    n = container.dimension
    lengths = (upper - lower)[:n].tolist()
    lengths[-1] = height
    axes = "".join(axis for axis, wraps in zip("xyz", container.periodic, strict=True) if wraps)
    make = Box if n == 3 else Rectangle
    return make(tuple(lengths), axes, origin=tuple(lower[:n].tolist()))
