"""Spheres that are compacted layer by layer: each new one is pressed between those before it and a plate above."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.packing.jamming.spheres import SoftSpheres


class LayeredSpheres:
    """Compressor of spheres and disks in layers: see :class:`voxgran.packing.jamming.model.Compressor`.

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
