"""`twin`: a packing of any number of grains that equals a sample in grains, sizes and solid fraction, at rest.

What is asked of a twin is checked once; a twin is then packed with a seed.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers, as_choice, as_count, as_length, as_share, check_type
from voxgran._base.calls import explained, explained_methods
from voxgran._base.errors import InputError
from voxgran._base.files import as_path
from voxgran._base.progress import OnStep, Step, numbered, repeated
from voxgran._base.seeds import stream
from voxgran._base.units import NO_UNIT
from voxgran.containers.gravity import as_down, main_axis
from voxgran.containers.kinds.box import Box
from voxgran.containers.model import Container, check_container
from voxgran.packing.draw import Request
from voxgran.packing.driver import check_drive
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.pack import pack
from voxgran.scene.twins.compared import comparison_of
from voxgran.scene.twins.page import write_page
from voxgran.scene.twins.sample import Sample, resolved, sample_of
from voxgran.shapes.learning.learn import learn_shapes
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.simplify import FEWEST, simplified
from voxgran.shapes.size_laws.listed import refuse_too_many
from voxgran.shapes.sizes import discrete

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
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    on_step: OnStep | None = None,
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
    checkpoint : path-like, optional
        File for checkpoints of the first packing, as in :func:`voxgran.pack`; those of the others have its name with
        ``.1``, ``.2`` and so on behind it. They also hold packings that are finished.
    resume : bool
        Whether to go on from these files where they are there.
    on_step : callable, optional
        Told of each step; default: at a terminal and in a notebook, a line on the error stream every ten seconds,
        elsewhere a record of the logger ``voxgran`` of the level INFO.
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
    CheckpointError
        If a checkpoint is damaged, belongs to another run, or is another file, which is not replaced.
    OutputError
        If a checkpoint cannot be written.
    Interrupted
        On SIGINT, SIGTERM or SIGHUP: after a checkpoint was written.

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
    check_drive(checkpoint, resume, on_step, None)
    places = [None] * many if checkpoint is None else checkpoints_of(as_path(checkpoint), many)
    packings = [
        asked.packed(asked.seed + k, checkpoint=place, resume=resume, on_step=numbered(on_step, k, many))
        for k, place in enumerate(places)
    ]
    return twin_of(asked, packings, voxel)


def checkpoints_of(first: Path, many: int) -> list[Path]:
    """Return the checkpoints of so many packings, of which the first is given."""
    return [first, *(first.with_name(f"{first.name}.{k}") for k in range(1, many))]


@dataclass(frozen=True, eq=False)
class TwinRequest:
    """What is asked of a twin: its arguments, checked, with their defaults."""

    sample: Sample
    container: Container
    count: int
    solid_fraction: float
    protocol: str
    forms: int
    faces: int
    seed: int  # of the model
    known: ShapeModel | None  # the model that is given
    parameters: Mapping[str, Any]

    @classmethod
    def of(
        cls,
        given: Packing | Sequence[Shape],
        container: Container | None,
        *,
        model: ShapeModel | None,
        faces: int,
        forms: int,
        seed: int,
        count: int | None = None,
        solid_fraction: float | None = None,
        protocol: str | None = None,
        **parameters: Any,
    ) -> Self:
        """Return the request with the arguments of :func:`voxgran.twin`.

        Raises
        ------
        InputError
            If no twin can be made of the sample, or an option is out of range.
        """
        for name in sorted(GIVEN & parameters.keys()):
            raise InputError(f"{name} is given: a twin has the grains of its sample, and its protocol; leave it out")
        if container is not None:
            check_container(container)
        if model is not None:
            check_type(model, ShapeModel, "model", "a ShapeModel; learn_shapes and ShapeModel.load make one")
        sample = sample_of(given, solid_fraction)
        wanted = sample.solid_fraction if solid_fraction is None else as_share(solid_fraction, "solid_fraction")
        gravity = None if sample.packing is None else sample.packing.gravity
        usual = "compress" if gravity is None else "gravity"
        how = as_choice(usual if protocol is None else protocol, "protocol", PROTOCOLS)
        mean = float((np.pi / 6 * libm.power(sample.laid_sizes(1000), 3)).mean())
        if count is None and container is not None:
            count = int(wanted * container.volume * (FILLED if how == "gravity" else 1.0) / mean)
            if count < 1:
                raise InputError(
                    f"the container has the volume {container.volume:.3g}: at a solid fraction of {wanted:.3g} no "
                    f"grain of the mean volume {mean:.3g} has room in it; take a larger one"
                )
        many = as_count(len(sample.shapes) if count is None else count, "count", at_least=1)
        refuse_too_many(many)
        different = min(as_count(forms, "forms", at_least=1), many)
        if how == "gravity" and gravity is not None:
            parameters.setdefault("gravity", tuple(gravity))
        if how == "compress":
            # the stress of a twin is not asked for, and its box stays one
            parameters.setdefault("shear", "held")
        volume = float((np.pi / 6 * libm.power(sample.laid_sizes(many), 3)).sum()) / wanted
        box = _box(volume, how, parameters.get("gravity")) if container is None else container
        first = as_count(seed, "seed")
        most = as_count(faces, "faces", at_least=FEWEST)
        return cls(sample, box, many, wanted, how, different, most, first, model, parameters)

    @cached_property
    def learned(self) -> tuple[Sample, ShapeModel | None]:
        """Sample at the resolution of the twin, and the model of its shapes; None where they are drawn themselves."""
        found = resolved(self.sample, self.faces)
        if self.known is not None:
            # both are then described at the same resolution
            return found, replace(self.known, shapes=simplified(self.known.shapes, self.faces))
        if not all(isinstance(shape.geometry, Mesh) for shape in found.shapes):
            return found, None
        return found, learn_shapes(found.shapes, weights=found.weights, seed=self.seed)

    def packed(self, seed: int, *, on_step: OnStep | None = None, **run: Any) -> Packing:
        """Return a twin with a seed, with options of the run of :func:`voxgran.pack`."""
        with repeated(on_step) as told:
            told(Step(stage="learning", done=0, total=0, text="the shapes of the sample"))
            asked = self._asked(seed, *self.learned)
        return pack(**asked, **self.parameters, on_step=on_step, **run)

    def stand_in(self, seed: int) -> Request:
        """Return what is packed with the shapes of the sample themselves, which costs as much."""
        return Request(**self._asked(seed, self.sample, None), parameters=dict(self.parameters))

    def _asked(self, seed: int, sample: Sample, model: ShapeModel | None) -> dict[str, Any]:
        """Return the arguments of :func:`voxgran.pack`."""
        shapes, shape_id, sizes = drawn(sample, self.count, model, self.forms, seed)
        # growing grains scales sizes and takes no list
        grains = (
            {"count": self.count, "sizes": discrete(sizes, np.ones(self.count))}
            if self.protocol == "expand"
            else {"grains": {"shape": shape_id, "diameter": sizes}}
        )
        unit = None if sample.unit == NO_UNIT else sample.unit
        asked = {"method": self.protocol, "seed": seed, "solid_fraction": self.solid_fraction, "unit": unit}
        return {"shapes": shapes, "container": self.container, **asked, **grains}


def twin_of(asked: TwinRequest, packings: Sequence[Packing], voxel_size: float | None) -> Twin:
    """Return the twin that packings of a request are."""
    found, model = asked.learned
    return Twin(sample=found, packings=tuple(packings), model=model, voxel_size=voxel_size, faces=asked.faces)


#: depth of a bed over its width, height of its container over that depth, and share of a container that beds fill
DEEP, ROOM, FILLED = 1.5, 3.0, 0.8
PROTOCOLS = ("gravity", "compress", "expand")
#: arguments of `pack` that a twin gives itself
GIVEN = frozenset(("shapes", "sizes", "grains", "weights", "weights_by", "method", "unit", "start"))


def drawn(
    sample: Sample, count: int, model: ShapeModel | None, forms: int, seed: int
) -> tuple[list[Shape], Integers, Floats]:
    """Return shapes of a model, or of the sample, and shape and diameter of each grain (count,), from small to large.

    The diameters are laid over the distribution of the sample. A shape is that of grains whose sizes follow each other,
    in the order of the sizes that the model has drawn, so that form and size stay related as they are. Of sizes of the
    model only this order counts, so that its unit is none of the twin.
    """
    if model is None:
        share = np.cumsum(sample.weights) / sample.weights.sum()
        at = (stream(seed, "twin shapes").random() + np.arange(forms)) / forms % 1.0
        shapes = [sample.shapes[k] for k in np.searchsorted(share, at, side="right")]
    else:
        shapes = list(model.sample(forms, seed=seed))
    shapes.sort(key=lambda shape: shape.diameter)
    if model is not None and sample.unit != (model.unit or NO_UNIT):
        shapes = [replace(shape, unit=sample.unit) for shape in shapes]
    return shapes, np.arange(count) * len(shapes) // count, sample.laid_sizes(count)


def _box(volume: float, protocol: str, gravity: Any) -> Box:
    """Return a periodic box that grains fill at rest, or one with a floor in which they come to rest as a bed."""
    if protocol != "gravity":
        return Box((volume ** (1 / 3),) * 3, "xyz")
    asked = as_down(gravity, Box((1.0, 1.0, 1.0)))
    down = np.abs(main_axis(np.array((0.0, 0.0, -1.0) if asked is None else asked, dtype=np.float64)))
    width = (volume / DEEP) ** (1 / 3)
    lengths = np.where(down > 0, DEEP * ROOM * width, width)
    return Box(lengths, tuple(bool(one) for one in down == 0))
