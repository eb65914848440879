"""Jamming: grains at random points grow until no common factor on their sizes leaves them free of overlap.

Frictionless spheres then have as many contacts as hold them, six on average, and disks four, apart from rattlers, which
no contact holds. The gradation stays as it is drawn, up to the factor; or the sizes stay and the container shrinks.

Works for spheres and disks (:mod:`voxgran.packing.jamming.spheres`), and for all other solids and outlines, scanned
meshes and clumps of spheres included, in containers whose walls are known (:mod:`voxgran.packing.jamming.solids`). The
latter move at random while they grow: the slower the growth, the denser and the more ordered they jam.

Equal disks crystallize: in two dimensions take at least two sizes for a disordered packing.

References
----------
O'Hern, Silbert, Liu & Nagel 2003, Jamming at zero temperature and zero applied stress: the epitome of disorder,
Physical Review E 68, 011306, doi:10.1103/PhysRevE.68.011306.
"""

from dataclasses import replace
from typing import Literal

from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.contacts.inside import Occupied
from voxgran.packing.jamming.method import CompressState, GrowthRate, advance, cost, first_state, packing_of_run
from voxgran.packing.method import PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem


@parameter_class
class Jam(GrowthRate):
    """Parameters of jamming.

    Parameters
    ----------
    keep
        what stays as it is given: the container, in which the grains grow or shrink by a common factor, or the sizes of
        the grains, about which the container does.

    Raises
    ------
    InputError
        If a value is not one of those listed.

    Examples
    --------
    >>> import voxgran as vg
    >>> jammed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4), periodic="xyz"), vg.methods.Jam(), count=30)
    >>> 0.55 < jammed.solid_fraction < 0.7
    True
    """

    keep: Literal["container", "sizes"] = parameter("container")


def prepare(problem: Problem) -> CompressState:
    """Return the state in which all grains are at random points, those of a start at their own.

    Raises
    ------
    InputError
        If a solid fraction is asked for, sizes are to be kept beside fixed grains, a shape is an open surface, or it is
        no sphere where the walls of the container are not known.
    """
    if problem.asked_fraction is not None:
        raise InputError(
            f"solid_fraction is {problem.asked_fraction:g}: method 'jam' finds the largest one by itself; leave it "
            "out, or give method='expand'"
        )
    if problem.parameters.keep == "sizes" and isinstance(problem.container, Occupied):
        raise InputError(
            "keep is 'sizes': the container would change its size around fixed grains, which do not; leave it out, or "
            "leave out the fixed grains"
        )
    return first_state(problem, jam=True)


def finish(problem: Problem, state: CompressState) -> Packing:
    """Return the packing, in the container as given or in one around grains of the sizes as drawn."""
    factor = state.compressor.factor
    if problem.parameters.keep == "container" or not problem.count:
        return packing_of_run(problem, state, factor)
    around = replace(problem, container=problem.container.scaled(1.0 / factor))
    return packing_of_run(around, state, 1.0, stretch=1.0 / factor)


registration = PackingMethod(
    summary="grains at random points grow until they jam; the densest random state of a gradation",
    source="O'Hern et al. 2003, doi:10.1103/PhysRevE.68.011306",
    parameters=Jam,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    tilted=True,
    dimensions=(2, 3),
    any_container=True,
    start="scaled",
    obstacles="apart",
    sizing="scaled",
)
