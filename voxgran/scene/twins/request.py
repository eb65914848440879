"""What a twin is to be, checked once, and how one is packed with a seed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_choice, as_count, as_share, check_type
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran._base.units import NO_UNIT
from voxgran.containers.gravity import as_down, main_axis
from voxgran.containers.kinds.box import Box
from voxgran.containers.model import Container, check_container
from voxgran.packing.draw import Request
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.scene.twins.sample import Sample, resolved, sample_of
from voxgran.shapes.learning.learn import learn_shapes
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.simplify import simplified
from voxgran.shapes.size_laws.listed import refuse_too_many
from voxgran.shapes.sizes import discrete

#: depth of a bed over its width, height of its container over that depth, and share of a container that beds fill
DEEP, ROOM, FILLED = 1.5, 3.0, 0.8
PROTOCOLS = ("gravity", "compress", "expand")
#: arguments of `pack` that a twin gives itself
GIVEN = frozenset(("shapes", "sizes", "grains", "weights", "weights_by", "method", "unit", "start"))


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
        mean = float((np.pi / 6 * sample.laid_sizes(1000) ** 3).mean())
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
        volume = float((np.pi / 6 * sample.laid_sizes(many) ** 3).sum()) / wanted
        box = _box(volume, how, parameters.get("gravity")) if container is None else container
        first = as_count(seed, "seed")
        return cls(sample, box, many, wanted, how, different, faces, first, model, parameters)

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

    def packed(self, seed: int, **run: Any) -> Packing:
        """Return a twin with a seed, with options of the run of :func:`voxgran.pack`."""
        asked = self._asked(seed, *self.learned)
        return pack(**asked, **self.parameters, **run)

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
