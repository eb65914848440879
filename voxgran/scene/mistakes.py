"""Mistakes of a scene: those of independent sections are raised together, so that one reading finds them all."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from voxgran._base.calls import removal_of
from voxgran._base.config import parameters_of
from voxgran._base.errors import InputError, UnknownNameError, VoxgranError
from voxgran._base.names import unknown
from voxgran.scene.keys import (
    AnyShape,
    Listed,
    Measured,
    NamedMaterial,
    Oriented,
    Packed,
    Settled,
    ShapeOfFamily,
    ShapeOfFile,
    Shares,
    names_of,
)
from voxgran.scene.sections import General, Output
from voxgran.settling.compression_parameters import Compression
from voxgran.settling.material import Material
from voxgran.settling.parameters import Settling

#: keys of the sections, to name the right one where a key is in another; [packing] and [scene] come first
_PLACES = {
    "[scene]": names_of(General),
    "[packing]": names_of(Packed),
    "[output]": names_of(Output),
    "[settle]": names_of(Settled, Settling),
    "[compress]": names_of(Compression),
    "[material]": names_of(Material),
    "[[material]]": names_of(NamedMaterial),
    "[measure]": names_of(Measured),
    "[sizes]": names_of(Shares),
    "[orientations]": names_of(Oriented),
    "[grains]": names_of(Listed),
    "[[shape]]": names_of(ShapeOfFamily, ShapeOfFile, AnyShape),
}


class Mistakes:
    """Errors of the parts of one input."""

    def __init__(self) -> None:
        self.found: list[VoxgranError] = []

    @contextmanager
    def part(self, section: str = "") -> Iterator[None]:
        """Keep an error of bad input that the block raises (context manager), which names a section if one is given."""
        try:
            yield
        except VoxgranError as error:
            if error.exit_code != InputError.exit_code:
                raise
            told = str(error)
            self.found.append(error if told.startswith("[") or not section else type(error)(f"{section} {told}"))

    def refuse(self) -> None:
        """Raise what was found.

        Raises
        ------
        VoxgranError
            The only error that was found.
        InputError
            If there are several, with the sentences of all.
        """
        if len(self.found) == 1:
            raise self.found[0]
        if self.found:
            listed = "; ".join(f"({number}) {error}" for number, error in enumerate(self.found, 1))
            raise InputError(f"the scene has {len(self.found)} mistakes: {listed}")


def refuse_unknown(mapping: Mapping[str, Any], place: str, cls: type, *, beside: tuple[str, ...] = ()) -> None:
    """Refuse keys of a section that are neither parameters of its class nor among those beside.

    Raises
    ------
    UnknownNameError
        If there is one; the message names the section whose key it is, or else the nearest key.
    """
    known = (*(name for item in parameters_of(cls) for name in item.names), *beside)
    for key in mapping:
        if key not in known:
            gone = removal_of(cls, key, place)
            right = next((other for other, names in _PLACES.items() if other != place and key in names), None)
            moved = f"{place} key {key!r} is unknown: it is a key of {right}; write it there" if right else ""
            raise UnknownNameError(gone or moved or unknown(f"{place} key", key, known))
