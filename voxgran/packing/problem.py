"""Problem: what a packing method is given, with representations of the shapes made on demand.

All lengths in here are in the normalized frame, whose unit is the median diameter of the grains: a scene and the same
scene in other units give the same numbers. Representations are kept under a byte limit, oldest out first.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError
from voxgran.containers.model import Container
from voxgran.lattice.grid import Grid
from voxgran.packing.start import Start
from voxgran.points.control import sample_controls
from voxgran.points.sample import SurfacePoints
from voxgran.shapes.model import Shape
from voxgran.voxels.occupy import occupy


@dataclass(eq=False)
class Problem:
    """A packing task in the normalized frame.

    Attributes
    ----------
    shapes : tuple of Shape
        The different shapes at unit equivalent diameter.
    shape_id : (n,) ndarray of int
        Which shape each grain has.
    diameter : (n,) ndarray of float
        Equivalent diameter of each grain, in median diameters; the factor on the shape's lengths.
    container : Container
        What holds the grains, in median diameters.
    parameters : object
        Parameter object of the method; its lengths are in `unit_length`.
    seed : int
        Seed of the run.
    unit_length : float
        The median diameter in the user's unit of lengths.
    original : tuple of Shape
        The shapes as the user gave them.
    start : Start or None
        Poses of the first grains, which are there from the beginning.
    unit : str
        The user's unit of lengths.
    density : float
        Density of the material.
    target : bool
        Whether so many grains are asked for, by number or by volume; otherwise they are as many as could be needed.
    byte_limit : int
        How many bytes of representations are kept.
    made : dict of str to set of int
        Hashes of all representations that were ever made, by what counts them; a checkpoint holds these, so that what
        is made again after it is not counted again.
    """

    shapes: tuple[Shape, ...]
    shape_id: Integers
    diameter: Floats
    container: Container
    parameters: Any
    seed: int
    unit_length: float
    original: tuple[Shape, ...]
    start: Start | None = None
    unit: str = "1"
    density: float = 1.0
    target: bool = False
    byte_limit: int = 2**26
    made: dict[str, set[int]] = field(default_factory=lambda: {"voxelized_shapes": set(), "sampled_shapes": set()})
    _kept: "OrderedDict[tuple[Any, ...], Any]" = field(default_factory=OrderedDict)
    _bytes: int = 0

    @property
    def count(self) -> int:
        """Number of grains that are asked for."""
        return len(self.shape_id)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.container.dimension

    @property
    def volumes(self) -> Floats:
        """True volumes of the grains, (n,)."""
        shapes = np.array([shape.volume for shape in self.shapes])
        return shapes[self.shape_id] * self.diameter**self.dimension

    @property
    def counters(self) -> dict[str, int]:
        """How many different solids were turned into voxels, and into points."""
        return {name: len(keys) for name, keys in self.made.items()}

    def length(self, value: float) -> float:
        """Return a length given in the user's unit in median diameters."""
        return value / self.unit_length

    def voxels(self, grain: int, orientation: Floats, voxel_size: float, *, cover: str) -> Booleans:
        """Return the voxels of a grain on a cubic lattice with a voxel corner at its centroid.

        Parameters
        ----------
        grain : int
            Which grain.
        orientation : (4,) ndarray of float
            Unit quaternion (w, x, y, z).
        voxel_size : float
            Edge of a voxel, in median diameters.
        cover : {"touch", "center"}
            Which voxels are taken.

        Returns
        -------
        (2 k, 2 k, 2 k) ndarray of bool
            In 2D (2 k, 2 k, 1). The centroid is at the middle corner.

        Raises
        ------
        InputError
            If the grain holds no center of a voxel, and those are asked for.
        """
        shape, diameter = self.shapes[self.shape_id[grain]], float(self.diameter[grain])
        if shape.is_sphere:
            orientation = np.array([1.0, 0.0, 0.0, 0.0])
        key = ("voxels", self.shape_id[grain], diameter, orientation.tobytes(), voxel_size, cover)

        def make() -> Booleans:
            half = int(np.ceil(shape.bounding_radius * diameter / voxel_size)) + 1
            tall = 2 * half if self.dimension == 3 else 1
            low = -half * voxel_size
            grid = Grid((low, low, low if tall > 1 else 0.0), voxel_size, (2 * half, 2 * half, tall))
            self._count("voxelized_shapes", key)
            mask = occupy(shape, grid, scale=diameter, rotation=orientation, cover=cover)
            if not mask.any():
                raise InputError(
                    f"voxel_size is {voxel_size * self.unit_length:.6g}: in some orientation a grain of diameter "
                    f"{diameter * self.unit_length:.6g} holds no center of a voxel and would take no room; use smaller "
                    "voxels, or cover 'touch'"
                )
            return mask

        return self.keep(key, make)

    def points(self, shape: int, spacing: float) -> SurfacePoints:
        """Return control points on a shape of unit diameter, every surface point within spacing / 2 of one.

        Parameters
        ----------
        shape : int
            Which shape.
        spacing : float
            Wanted spacing, in diameters of the shape.
        """
        key = ("points", shape, spacing)

        def make() -> SurfacePoints:
            self._count("sampled_shapes", key)
            return sample_controls(self.shapes[shape], spacing=spacing, seed=self.seed)

        return self.keep(key, make)

    def _count(self, name: str, key: tuple[Any, ...]) -> None:
        """Count what is made under a key, once."""
        digest = hashlib.blake2b(repr(key).encode(), digest_size=8).digest()
        self.made[name].add(int.from_bytes(digest, "little"))

    def keep(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        """Return what is kept under a key, made if needed; the oldest leave when the limit is passed."""
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        made = make()
        self._kept[key] = made
        self._bytes += made.nbytes
        while self._bytes > self.byte_limit and len(self._kept) > 1:
            self._bytes -= self._kept.popitem(last=False)[1].nbytes
        return made
