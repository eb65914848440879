"""What every measure must keep, as a class of tests to derive from."""

import warnings
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from voxgran._base.errors import PackingWarning
from voxgran.containers.kinds.box import Box
from voxgran.io.netcdf import load_statistics, save_statistics
from voxgran.measures.model import Measure, measure, measure_registry
from voxgran.packing.model import Packing
from voxgran.shapes.family import make_shape

#: spheres along each axis of the default packing
ALONG = 4


class MeasureSuite:
    """Tests of one measure; derive from it in a test file and name the measure.

    Attributes
    ----------
    name : str
        Name under which the measure is registered.

    Examples
    --------
    >>> from voxgran.testing import MeasureSuite
    >>> class TestCoordination(MeasureSuite):
    ...     name = "coordination"
    """

    name: ClassVar[str] = ""

    @classmethod
    def packing(cls, unit: str = "mm") -> Packing:
        """Return the packing that is measured: 64 unit spheres that touch, on a simple cubic lattice."""
        places = np.indices((ALONG,) * 3).reshape(3, -1).T + 0.5
        return Packing.of([make_shape("sphere")], Box((ALONG,) * 3, "xyz"), position=places, unit=unit)

    @classmethod
    def empty(cls) -> Packing:
        """Return a packing of no grains."""
        return Packing.of([make_shape("sphere")], Box((ALONG,) * 3, "xyz"), position=np.zeros((0, 3)))

    @classmethod
    def entry(cls) -> Measure:
        """Return the registration of the measure."""
        return measure_registry().get(cls.name)

    @classmethod
    def measured(cls, packing: Packing) -> Any:
        """Return the tree of a packing, with this measure and the provenance."""
        with warnings.catch_warnings(action="ignore", category=PackingWarning):
            return measure(packing, [cls.name])

    @classmethod
    @cache
    def _found(cls) -> tuple[Packing, Any, Any]:
        """Return the packing, what the measure alone computes, and the tree: once for all tests."""
        packing = cls.packing()
        return packing, cls.entry().compute(packing), cls.measured(packing)

    def test_it_fills_the_groups_that_it_names(self) -> None:
        """Each group that it computes is named in the registration, and has variables in the tree."""
        entry, (packing, found, tree) = self.entry(), self._found()
        assert entry.name == self.name
        assert entry.summary
        assert entry.applies(packing)
        assert set(found) <= set(entry.groups)
        assert found
        assert all(tree[group].data_vars for group in found)

    def test_units_and_names_everywhere(self) -> None:
        """Each variable has a unit and a long name."""
        for group, dataset in self._found()[1].items():
            for name, values in dataset.variables.items():
                assert {"units", "long_name"} <= set(values.attrs), (group, name)

    def test_it_does_not_change_the_packing(self) -> None:
        """The same packing gives the same numbers again."""
        packing, found, tree = self._found()
        for group, dataset in found.items():
            for name, values in dataset.variables.items():
                assert tree[group].variables[name].identical(values), (group, name)
        assert packing == self.packing()

    def test_no_grains_are_measured_or_left_out(self) -> None:
        """Without grains there are numbers, NaN or empty columns, and no error; or the measure does not apply."""
        packing = self.empty()
        if self.entry().applies(packing):
            assert int(self.measured(packing)["/"]["count"]) == 0

    def test_it_survives_a_file(self, tmp_path: Path) -> None:
        """A statistics file gives back the same tree."""
        tree = self._found()[2]
        save_statistics(tree, tmp_path / "statistics.nc")
        back = load_statistics(tmp_path / "statistics.nc")
        for node in tree.subtree:
            for name, values in node.data_vars.items():
                np.testing.assert_array_equal(back[node.path][name].values, values.values)
