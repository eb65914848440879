"""Accessor of xarray: ``tree.voxgran`` on statistics, registered when voxgran first measures or reads some."""

import json
import math
from collections.abc import Mapping
from typing import Any

from voxgran._base import ExplainedAttributes
from voxgran._base.errors import check_known
from voxgran._base.lazy import Dataset, DataTree, load

NAME = "voxgran"


class StatisticsAccessor(ExplainedAttributes):
    """Numbers with their units, and their provenance.

    Parameters
    ----------
    statistics : xarray.DataTree or xarray.Dataset
        What :func:`voxgran.measure` returns, or one of its groups.
    """

    def __init__(self, statistics: "DataTree | Dataset") -> None:
        self._statistics = statistics

    def __repr__(self) -> str:
        return "\n".join(self.text(name) for name in self.numbers) or "no numbers"

    @property
    def numbers(self) -> dict[str, float]:
        """All single numbers of this group by name."""
        variables = self._variables().items()
        return {str(name): float(value) for name, value in variables if not value.ndim and value.dtype.kind in "biuf"}

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance of the packing; empty if the statistics have none."""
        groups = getattr(self._statistics, "groups", ())
        source = self._statistics["/provenance"] if "/provenance" in groups else self._statistics
        return dict(json.loads(str(source["record"].item()))) if "record" in source.data_vars else {}

    def text(self, name: str) -> str:
        """Return a number as text: long name, four digits, unit.

        Parameters
        ----------
        name : str
            One of :attr:`numbers`.

        Raises
        ------
        UnknownNameError
            If there is no number of that name.
        """
        numbers = self.numbers
        check_known("number", name, numbers)
        attrs = self._variables()[name].attrs
        unit = str(attrs.get("units", "1"))
        value = "not known" if math.isnan(numbers[name]) else f"{numbers[name]:.4g}"
        return f"{attrs.get('long_name', name)}: {value}" + ("" if unit == "1" else f" {unit}")

    def _variables(self) -> Mapping[Any, Any]:
        """Return the variables of this group."""
        return dict(self._statistics.data_vars)


def register_accessor() -> None:
    """Register the accessor for datasets and trees of xarray; repeated calls have no effect."""
    xarray = load("xarray")
    for kind, register in (
        (xarray.Dataset, xarray.register_dataset_accessor),
        (xarray.DataTree, xarray.register_datatree_accessor),
    ):
        if NAME not in vars(kind):
            register(NAME)(StatisticsAccessor)
