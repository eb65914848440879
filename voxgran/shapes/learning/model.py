"""ShapeModel: a distribution of shapes, which draws grains like those of the sample that it was learned from."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, as_count
from voxgran._base.calls import explained_methods
from voxgran._base.seeds import stream
from voxgran.shapes.describing.thumbnail import card
from voxgran.shapes.family import MOST_SHAPES
from voxgran.shapes.learning.bend import Soft, bent, soft_fields
from voxgran.shapes.learning.files import read_model, write_model
from voxgran.shapes.learning.report import ShapeReport, compared
from voxgran.shapes.learning.warp import Kernel, frame_of, placed, warped, width_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape


@explained_methods
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ShapeModel(ExplainedAttributes):
    """Distribution of shapes and sizes, learned from a sample by :func:`voxgran.learn_shapes`.

    Attributes
    ----------
    shapes : tuple of Shape
        Grains of the sample as meshes, each of its true size.
    weights : (n,) ndarray of float
        How often each stands for a grain, of sum 1.
    donors : (n,) ndarray of float
        How often each is the donor of a grain, of sum 1: as its weight says, but for what makes up for the mean change
        of descriptors by the maps.
    strength : float
        Standard deviation of the shears and of the taper by which a new grain differs from one of the sample, or root
        mean square of the displacement of its surface, in equivalent diameters; the kernel density of ratios and sizes
        is narrower in proportion below 0.02, and wider above 0.08.
    method : str
        How grains are made: ``"warp"`` or ``"bend"``.
    softest : dict
        Fields in which donors bend most easily, by their number: found as they are needed, and not saved.

    Examples
    --------
    >>> import voxgran as vg
    >>> model = vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12))
    >>> len(model.shapes), len(model.sample(20))
    (12, 20)
    """

    shapes: tuple[Shape, ...]
    weights: Floats
    donors: Floats
    strength: float
    method: str = "warp"
    softest: dict[int, Soft] = field(default_factory=dict)

    @property
    def unit(self) -> str | None:
        """Unit of lengths, if known."""
        return self.shapes[0].unit

    @cached_property
    def _kernel(self) -> Kernel:
        """Kernel density of the logarithms of principal ratios and sizes."""
        rows = []
        for shape in self.shapes:
            radius, _, roots, _ = frame_of(shape.geometry)  # type: ignore[arg-type]
            rows.append([libm.log(roots[1] / roots[0]), libm.log(roots[2] / roots[1]), libm.log(2 * radius)])
        return Kernel(np.array(rows), self.weights, self.donors, width_of(self.strength))

    def __repr__(self) -> str:
        """Show method, number of grains and strength."""
        return f"ShapeModel({self.method!r}, grains={len(self.shapes)}, strength={self.strength:g})"

    def sample(self, count: int, *, seed: int = 0) -> list[Shape]:
        """Draw grains.

        Each grain of the sample is the donor of as many as its number in `donors` says, to one, so that the counts of
        kinds of grains hardly vary.

        Parameters
        ----------
        count : int
            Number of grains, at most a million.
        seed : int
            Seed; the same seed and count give the same bits.

        Returns
        -------
        list of Shape
            Meshes of true size about their centroids. The `record` of each has the ``donor``, the number of a grain of
            the sample, and the ``map`` (4, 4), the homogeneous matrix that takes the donor's vertices to those of the
            grain: a determinant below 0 is that of a mirrored grain. Where grains bend, ``bend`` has the coefficients
            (20, 3) of the displacement before the map, of the monomials of degree 3 at most.

        Raises
        ------
        InputError
            If the count is not a whole number from 0 to a million.

        Examples
        --------
        >>> import voxgran as vg
        >>> model = vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12))
        >>> grain = model.sample(3, seed=1)[0]
        >>> grain.record["donor"] < 12, grain.record["map"].shape
        (True, (4, 4))
        """
        count = as_count(count, "count", at_most=MOST_SHAPES)
        donors = self._kernel.grains(count, stream(seed, "donors of learned grains"))
        return [self._made(int(donor), stream(seed, "learned grains", k)) for k, donor in enumerate(donors)]

    def draw(self, generator: np.random.Generator) -> Shape:
        """Draw a single grain by a random generator."""
        return self._made(int(self._kernel.grains(1, generator)[0]), generator)

    def _made(self, donor: int, generator: np.random.Generator) -> Shape:
        """Return a grain made of one of the sample."""
        wanted, given = self._kernel.draw(donor, generator), self.shapes[donor].geometry
        assert isinstance(given, Mesh)
        record: dict[str, Any] = {"donor": donor}
        if self.method == "bend":
            if donor not in self.softest:
                self.softest[donor] = soft_fields(given)
            given, record["bend"] = bent(given, self.softest[donor], self.strength, generator)
            mesh, record["map"] = placed(given, float(wanted[2]), generator)
        else:
            mesh, record["map"] = warped(given, wanted, self.strength, generator)
        return Shape(mesh, "learned", unit=self.unit, record=record)

    def report(
        self, test: Sequence[Shape] | None = None, *, count: int = 200, descriptors: bool = True, seed: int = 0
    ) -> ShapeReport:
        """Compare grains that are drawn with those of the sample, or with others that were not learned from.

        Parameters
        ----------
        test : sequence of Shape, optional
            Other grains of the same kind; default: those of the sample.
        count : int
            Number of grains that are drawn.
        descriptors : bool
            Whether the descriptors of :func:`voxgran.describe` are compared, which take most of the time; otherwise
            sphericity, convexity, the ratios of the second moments, and a roundness that is relative to these.
        seed : int
            Seed of all that is drawn.

        Returns
        -------
        ShapeReport

        Raises
        ------
        InputError
            If there are fewer than 10 test grains, one is open or plane, or the count is below 10.

        Examples
        --------
        >>> import voxgran as vg
        >>> model = vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=20))
        >>> report = model.report(vg.make_shapes("convex_polyhedron", count=20, seed=1), count=20, descriptors=False)
        >>> "energy_distance" in report.table, len(report.pairs)
        (True, 12)
        """
        drawn = self.sample(as_count(count, "count", at_least=10), seed=seed)
        return compared(self.shapes, self.weights, drawn, test, descriptors=descriptors, seed=seed)

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the model to a netCDF4 file.

        Parameters
        ----------
        path : path-like
            File to write, ``.nc``.
        overwrite : bool
            Whether a file that is there may be replaced.

        Raises
        ------
        FileFormatError
            If the suffix is not ``.nc``.
        OutputExistsError
            If the file is there and `overwrite` is false.
        OutputError
            If it cannot be written; what was there before is untouched.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12)).save("shapes.nc")
        >>> vg.ShapeModel.load("shapes.nc")
        ShapeModel('warp', grains=12, strength=0.05)
        """
        facts = {"method": self.method, "strength": self.strength}
        write_model(path, self.shapes, {"weights": self.weights, "donors": self.donors}, facts, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "ShapeModel":
        """Read a model from a file that :meth:`save` wrote.

        Raises
        ------
        MissingFileError
            If there is no such file.
        FileFormatError
            If it is damaged, or holds something else.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12)).save("rocks.nc")
        >>> len(vg.ShapeModel.load("rocks.nc").sample(5))
        5
        """
        shapes, facts = read_model(path)
        return cls(shapes=shapes, **facts)

    def _repr_html_(self) -> str:
        """Small picture and numbers, for notebooks."""
        sizes = [shape.diameter for shape in self.shapes]
        unit = f" {self.unit}" if self.unit else ""
        rows: dict[str, Any] = {
            "method": self.method,
            "grains": f"{len(self.shapes)}",
            "equivalent diameter": f"{min(sizes):.4g} to {max(sizes):.4g}{unit}",
            "strength": f"{self.strength:g}",
        }
        return card(None, rows)
