"""Expansion: grains grow at random points and push each other apart to the solid fraction that is asked for.

All sizes are multiplied by one factor, so that the gradation stays exactly as it is drawn, and the solid fraction is
met exactly, at any number of grains. Grains of a start keep their sizes, and the solid fraction is that of the others;
where there are no others, the grains of the start get the factor that meets it. Where the solid fraction is beyond that
at which the grains jam, the densest state that was found is the result, and a warning says so. Without a count and a
solid fraction the grains are packed as densely as by ``jam``.

Works for spheres and disks (:mod:`voxgran.packing.jamming.spheres`), and for all other solids and outlines, scanned
meshes and clumps of spheres included, in containers whose walls are known (:mod:`voxgran.packing.jamming.solids`). The
latter move at random while they grow: the slower the growth, the denser and the more ordered they jam.

Equal disks crystallize: in two dimensions take at least two sizes for a disordered packing.

References
----------
Lubachevsky & Stillinger 1990, Geometric properties of random disk packings, Journal of Statistical Physics 60, 561-583,
doi:10.1007/BF01025983: the idea, by collisions; here the growth is quasi-static.
O'Hern, Silbert, Liu & Nagel 2003, Jamming at zero temperature and zero applied stress: the epitome of disorder,
Physical Review E 68, 011306, doi:10.1103/PhysRevE.68.011306.
"""

from voxgran._base.config import parameter_class
from voxgran._base.errors import PackingWarning, warn
from voxgran.containers.gravity import Down
from voxgran.packing.jamming.method import CompressState, GrowthRate, advance, cost, first_state, packing_of_run
from voxgran.packing.method import PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem


@parameter_class
class Expand(GrowthRate):
    """Parameters of the expansion.

    Examples
    --------
    >>> import voxgran as vg
    >>> box = vg.Box((4, 4, 4), periodic="xyz")
    >>> packing = vg.pack(vg.shapes.sphere(), box, vg.methods.Expand(), count=20, solid_fraction=0.4)
    >>> round(packing.solid_fraction, 6)
    0.4
    """


def prepare(problem: Problem) -> CompressState:
    """Return the state in which all grains are at random points, those of a start at their own.

    Raises
    ------
    InputError
        If a shape is an open surface, or no sphere where the walls of the container are not known.
    """
    return first_state(problem, jam=not problem.target and problem.start is None)


def finish(problem: Problem, state: CompressState, gravity: Down | None = None) -> Packing:
    """Return the packing; where sizes cannot be kept, of a count or of a start, a warning says so."""
    factor, keeps = state.compressor.factor, problem.count > problem.started > 0
    if factor < 1.0 and (state.stop_reason == "count" or (keeps and state.stop_reason == "full")):
        also = ", those of the start too," if keeps else ""
        warn(
            f"the grains{also} have {factor:.4g} times the sizes that were drawn: more do not fit; ask for fewer or "
            "smaller grains, or make the container larger",
            PackingWarning,
        )
    return packing_of_run(problem, state, factor, gravity=gravity)


registration = PackingMethod(
    summary="grains at random points grow, and push each other apart, to any solid fraction up to jamming",
    source="Lubachevsky & Stillinger 1990, doi:10.1007/BF01025983; O'Hern et al. 2003, doi:10.1103/PhysRevE.68.011306",
    parameters=Expand,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    tilted=True,
    dimensions=(2, 3),
    any_container=True,
    start="moved",
    obstacles="apart",
    sizing="scaled",
    keeps_sizes=True,
)
