"""Distance of a packing from rest, as an engine found it: sinking and change of the coordination number."""

from voxgran._base.errors import InputError
from voxgran.measures.model import Groups, Measure, dataset, variable
from voxgran.packing.model import Packing


def _compute(packing: Packing) -> Groups:
    """Return the numbers of the relaxation that the packing is the end of.

    Raises
    ------
    InputError
        If the packing was not relaxed.
    """
    found = packing.relaxation
    if found is None:
        raise InputError(
            "relaxation of the packing is None: it is known of a packing that an engine brought to rest; "
            "use relax, or leave this measure out"
        )
    change = found.coordination_after - found.coordination_before
    where = f"from the start to the end of a run of {found.engine}"
    return {
        "/": dataset(
            {
                "sinking": variable((), found.sinking, "1", f"mean sinking of the bulk {where}, in median diameters"),
                "largest_displacement": variable(
                    (), found.largest_displacement, "1", f"largest displacement of a grain {where}, in median diameters"
                ),
                "mean_displacement": variable(
                    (), found.mean_displacement, "1", f"mean displacement of a grain {where}, in median diameters"
                ),
                "change_of_coordination": variable((), change, "1", f"change of the mean coordination number {where}"),
            }
        )
    }


def _applies(packing: Packing) -> bool:
    """Return whether the packing was relaxed."""
    return packing.relaxation is not None


registration = Measure(
    summary="sinking of the bulk and change of the coordination number while an engine brought the packing to rest",
    groups=("/",),
    compute=_compute,
    tilted=True,
    applies=_applies,
)
