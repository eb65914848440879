"""Parameters that the walking methods share: gravity, feeding, vibration and the lid.

The groups are dataclasses that a method inherits from, so that the keys of a scene and the keywords of
:func:`voxgran.pack` stay flat. A method may declare a parameter again to give it another default.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from voxgran._base.config import check_bounds, parameter
from voxgran._base.errors import InputError

#: largest number of sweeps: with any number of grains the number of attempts is then a 64-bit integer
MOST_SWEEPS = 10**9


@dataclass(frozen=True, kw_only=True)
class Feeding:
    """How grains enter the container.

    Parameters
    ----------
    gravity
        direction of gravity, as an axis or as a vector of any length; if omitted, '-z', and '-y' in two dimensions.
    feed
        how grains are inserted: one by one at the top, from where each falls on those below while the newest ones move;
        in layers, each of which sinks before the next is inserted; or at random places in the whole container.
    rate
        fraction of the attempts that insert a grain, with feed 'rain'.
    layer_sweeps
        number of sweeps in which a layer sinks before the next is inserted, with feed 'layers'.
    """

    gravity: Literal["-x", "+x", "-y", "+y", "-z", "+z", "none"] | tuple[float, float, float] | None = parameter(None)
    feed: Literal["rain", "layers", "at_once"] = parameter("rain")
    rate: float = parameter(0.003, above=0.0, at_most=1.0)
    layer_sweeps: int = parameter(40, unit="attempts per grain", at_least=1, at_most=MOST_SWEEPS)


@dataclass(frozen=True, kw_only=True)
class Vibration:
    """How long grains move after all have entered, and how the bed is vibrated meanwhile.

    Parameters
    ----------
    sweeps
        number of attempts per grain after feeding has ended; with 200 or more, or a lid, the walk then goes on until
        the bed no longer sinks.
    cycles
        number of vibration cycles within the sweeps; if neither it nor the period is given, 1.
    period
        number of sweeps in a vibration cycle; an alternative to the number of cycles.
    decay
        ratio of the vibration amplitude of a cycle to that of the previous one; if omitted, the amplitude falls
        linearly to zero over all cycles.
    """

    usual_cycles: ClassVar[int] = 1

    sweeps: int = parameter(100, unit="attempts per grain", at_least=0, at_most=MOST_SWEEPS)
    cycles: int | None = parameter(None, at_least=1, at_most=MOST_SWEEPS)
    period: int | None = parameter(None, unit="attempts per grain", at_least=1, at_most=MOST_SWEEPS)
    decay: float | None = parameter(None, at_least=0.0, at_most=1.0)


@dataclass(frozen=True, kw_only=True)
class Walking(Feeding, Vibration):
    """All parameters that the walking methods share.

    Parameters
    ----------
    lid
        whether a lid is lowered onto the bed after feeding, by one voxel or 1/32 of the median diameter at a time,
        where no grain is in the way.

    Raises
    ------
    InputError
        If a number is out of its range, or parameters do not go together.
    """

    lid: bool = parameter(False)

    def __post_init__(self) -> None:
        """Check the ranges, and that the parameters go together."""
        check_bounds(self)
        if self.cycles is not None and self.period is not None:
            raise InputError(
                f"cycles is {self.cycles} and period {self.period}: each makes the number of cycles; leave one out"
            )
        for name, asked in self.needs_gravity().items():
            if asked and self.gravity == "none":
                raise InputError(f"{name} and gravity 'none': it needs a direction of gravity; choose one")

    def needs_gravity(self) -> dict[str, bool]:
        """Return what needs a direction of gravity, as errors name it, and whether it is set."""
        return {"lid is true": self.lid}

    @property
    def number_of_cycles(self) -> int:
        """Number of vibration cycles, from the period where that is given."""
        if self.period is not None:
            return max(1, round(self.sweeps / self.period))
        return self.usual_cycles if self.cycles is None else self.cycles
