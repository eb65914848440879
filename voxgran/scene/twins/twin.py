"""`twin`: a packing of any number of grains that equals a sample in grains, sizes and solid fraction, at rest."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import as_count, as_length
from voxgran._base.calls import explained, explained_methods
from voxgran._base.units import NO_UNIT
from voxgran.containers.model import Container
from voxgran.packing.model import Packing, check_packing
from voxgran.scene.twins.compared import comparison_of
from voxgran.scene.twins.page import write_page
from voxgran.scene.twins.request import TwinRequest
from voxgran.scene.twins.sample import Sample, resolved, sample_of
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.model import Shape

if TYPE_CHECKING:
    from xarray import Dataset

#: most packings of one call
MOST_SEEDS = 1000


@explained_methods
@dataclass(frozen=True, eq=False, kw_only=True)
class Twin(ExplainedAttributes):
    """A sample and what was made after it.

    Attributes
    ----------
    sample : Sample
        The grains of the sample and for how many each stands, its solid fraction, and its packing.
    packings : tuple of Packing
        One for each seed.
    model : ShapeModel or None
        Distribution of shapes from which the grains were drawn; None where they are those of the sample.
    voxel_size : float or None
        Edge of the voxels on which both are compared; None for that of the scan.
    faces : int
        Most triangles of a grain, at which the forms of both are described.

    Examples
    --------
    >>> import voxgran as vg
    >>> spheres = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4), periodic="xyz"), "expand", count=40, solid_fraction=0.5)
    >>> twin = vg.twin(spheres, protocol="expand")
    >>> twin.packing.count, twin.model is None
    (40, True)
    """

    sample: Sample
    packings: tuple[Packing, ...]
    model: ShapeModel | None = None
    voxel_size: float | None = None
    faces: int = 200

    @property
    def packing(self) -> Packing:
        """The first of the packings."""
        return self.packings[0]

    @cached_property
    def comparison(self) -> "Dataset":
        """Measures of the sample and of the twin, with their scatter, along the dimension ``measure``.

        The variables are `sample` and `twin`, the `difference`, the standard errors `sample_scatter` and
        `twin_scatter`, and the `ratio` of the difference to both together. The scatter is that between eight blocks of
        each packing; with several seeds that of the twin is between packings. A ratio is NaN where one is unknown.
        Curves stand beside them, with the scatter of each value. Contacts of a scan are pairs of labels with two faces
        of voxels in common, and contacts of the twin are counted in its image alike.
        """
        return comparison_of(self.sample, self.packings, self.voxel_size)

    def compared_with(self, packing: Packing) -> "Dataset":
        """Return the comparison with another packing in place of the sample, such as a part of it that was kept apart.

        Parameters
        ----------
        packing : Packing
            The other packing, in any unit. Its labels become solids of the same kind as the labels of the sample.

        Returns
        -------
        xarray.Dataset
            As `comparison`.

        Raises
        ------
        InputError
            If it has fewer than 10 whole grains, or open surfaces.
        """
        check_packing(packing, "packing")
        if NO_UNIT not in (packing.unit, self.sample.unit):
            packing = packing.to_unit(self.sample.unit)
        other = resolved(sample_of(packing, self.sample.solid_fraction), self.faces, self.sample.kind)
        return comparison_of(other, self.packings, self.voxel_size)

    def report(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write a page of the sample beside the twin, with the table of differences, the largest first.

        Parameters
        ----------
        path : path-like
            File to write, ``.html``; the numbers are written to the same name with the suffix ``.json``.
        overwrite : bool
            Whether existing files may be replaced.

        Raises
        ------
        FileFormatError
            If the suffix is not ``.html``.
        OutputExistsError
            If a file exists and `overwrite` is false.
        OutputError
            If a file cannot be written.
        """
        write_page(self, path, overwrite=overwrite)


@explained(hint="twin(sample, count=500)")
def twin(
    sample: Packing | Sequence[Shape],
    container: Container | None = None,
    *,
    count: int | None = None,
    solid_fraction: float | None = None,
    protocol: Literal["gravity", "compress", "expand"] | None = None,
    model: ShapeModel | None = None,
    faces: int = 200,
    forms: int = 100,
    voxel_size: float | None = None,
    seed: int = 0,
    seeds: int = 1,
    **parameters: Any,
) -> Twin:
    """Make a packing that equals a sample in the forms and sizes of its grains and in its solid fraction, at rest.

    Parameters
    ----------
    sample : Packing or sequence of Shape
        What was scanned, such as :func:`voxgran.packing_of_labels` gives it, or any packing; or shapes at their own
        sizes with a `solid_fraction`. Grains that the border of an image cuts are left out, and the others stand for as
        many more as are cut (Miles 1974; Lantuejoul 1980).
    container : Container, optional
        What holds the twin. Default: a periodic box of the size of its grains; of a bed one with a floor.
    count : int, optional
        Number of grains. Default: as many as fill the container, without one as many as the sample has whole.
    solid_fraction : float, optional
        Solid fraction of the twin. Default: that of the sample, in its bulk where it is a bed.
    protocol : {"gravity", "compress", "expand"}, optional
        How the grains come together: as a bed, compressed to a stress without gravity, or grown in place, which gives
        no contacts that bear forces and makes form and size independent. Default: ``"gravity"`` where the sample has
        gravity, otherwise ``"compress"``. The friction, and in beds the shaking, are searched that give the solid
        fraction.
    model : ShapeModel, optional
        Distribution of shapes, as of :func:`voxgran.learn_shapes`, in any unit: the sample gives the sizes. Default:
        learned from the sample where its grains are meshes; other shapes are drawn from the sample by their
        weights. Labels of spheres and ellipsoids, from
        which nine surfaces in ten differ by a quarter of a voxel at most, become these, and labels of convex solids,
        within 0.32 voxels, convex polyhedra; the tenth stays meshes where it differs by twice as much.
    faces : int
        Most triangles of a grain: surfaces of labels have thousands, which settling does not need.
    forms : int
        Most different shapes; each is then that of several grains of nearly the same size.
    voxel_size : float, optional
        Edge of the voxels on which both are compared. Default: the contact gap of labels, which is their voxel, or the
        twentieth part of a mean diameter; larger where a packing had more than a million voxels.
    seed : int
        Seed of the grains and of the packing.
    seeds : int
        Number of packings, with the seeds `seed`, `seed` + 1 and so on, whose scatter is then known.
    **parameters
        Further parameters of the method of that name, such as ``friction``.

    Returns
    -------
    Twin
        Its `packing`, its `model`, and the `comparison` with the sample; ``twin.report("twin.html")`` is the page.

    Raises
    ------
    InputError
        If the sample has fewer than 10 whole grains, open surfaces, meshes of one shape only, in whatever sizes, or a
        solid fraction that rigid grains at rest cannot have; or if an option is out of range.

    Warns
    -----
    PackingWarning
        If no friction and shaking gives the solid fraction: the twin then has the nearest one. If no closed surface of
        at most `faces` triangles is found for some grains: these keep more.

    Notes
    -----
    A twin keeps what is measured here. It does not keep the history of the sample, cementation, or the directions of
    force chains.

    Examples
    --------
    >>> import voxgran as vg
    >>> spheres = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4), periodic="xyz"), "expand", count=40, solid_fraction=0.5)
    >>> twin = vg.twin(spheres, count=30, protocol="expand")
    >>> twin.packing.count, round(twin.packing.solid_fraction, 3)
    (30, 0.5)
    """
    voxel = None if voxel_size is None else as_length(voxel_size, "voxel_size")
    asked = TwinRequest.of(
        sample, container, count=count, solid_fraction=solid_fraction, protocol=protocol, model=model, faces=faces,
        forms=forms, seed=seed, **parameters,
    )  # fmt: skip
    many = as_count(seeds, "seeds", at_least=1, at_most=MOST_SEEDS)
    return twin_of(asked, [asked.packed(asked.seed + k) for k in range(many)], voxel)


def twin_of(asked: TwinRequest, packings: Sequence[Packing], voxel_size: float | None) -> Twin:
    """Return the twin that packings of a request are."""
    found, model = asked.learned
    return Twin(sample=found, packings=tuple(packings), model=model, voxel_size=voxel_size, faces=asked.faces)
