"""The volume from which a family begins: a family by name, a table of a family and its parameters, or a shape."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from voxgran._base.errors import InputError
from voxgran.shapes.family import families, make_shape
from voxgran.shapes.model import Shape

#: largest number of families that begin from each other
DEEPEST = 4


def check_base(base: str | Shape | Mapping[str, Any], depth: int = 0, *, called: str = "base") -> None:
    """Raise unless a base is a solid, or names a family of solids; `called` is its parameter, for messages.

    Raises
    ------
    UnknownNameError
        If there is no such family.
    InputError
        If it is plane or an open surface, a table names no family, or families begin from each other too often.
    """
    if isinstance(base, Shape):
        base.refuse_open("base volumes")
        flat, name = base.dimension == 2, base.name
    else:
        name = _named(base, called)
        entry = families().get(name)
        if entry.is_open:
            raise InputError(
                f"{called} is {name!r}: its surfaces are open and an inside is needed; take another family"
            )
        flat = entry.dimension == 2
        if depth == DEEPEST:
            raise InputError(
                f"base is {name!r} inside of {DEEPEST} others: at most {DEEPEST} may follow; leave some out"
            )
        if isinstance(base, Mapping) and "base" in base:
            check_base(base["base"], depth + 1)
    if flat:
        raise InputError(f"{called} is {name!r}, which is plane: a solid is needed; take another family")


def made_base(base: str | Shape | Mapping[str, Any], generator: np.random.Generator) -> Shape:
    """Return the base volume; where it gives no seed, that of a random family is drawn."""
    # drawn in any case, so that what follows does not depend on how the base is given
    seed = int(generator.integers(2**53))
    if isinstance(base, Shape):
        return base
    given = {"seed": seed, **({} if isinstance(base, str) else base)}
    given.pop("family", None)
    return make_shape(_named(base), **given)


def _named(base: str | Mapping[str, Any], called: str = "base") -> str:
    """Return the name of the family."""
    if isinstance(base, str):
        return base
    if not isinstance(base.get("family"), str):
        raise InputError(
            f"{called} is a table without family: it must name a family, such as {{family = 'ellipsoid'}}; add it"
        )
    return str(base["family"])
