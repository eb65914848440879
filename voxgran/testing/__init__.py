"""Tests for those who extend voxgran, with pytest: classes to derive from, one for each kind of extension.

:class:`PackingMethodSuite`, :class:`ShapeFamilySuite`, :class:`MeasureSuite`, :class:`ContainerSuite` and
:class:`EngineSuite` are what all of their kind must pass. pytest is needed by nothing else in voxgran and is imported
with this package only.
"""

import pytest

# so that a failed assertion shows the values compared, as in a test file
for _name in ("containers", "engines", "measures", "packing_methods", "shape_families"):
    pytest.register_assert_rewrite(f"voxgran.testing.{_name}")

from voxgran.testing.containers import ContainerSuite  # noqa: E402
from voxgran.testing.engines import EngineSuite  # noqa: E402
from voxgran.testing.measures import MeasureSuite  # noqa: E402
from voxgran.testing.packing_methods import PackingMethodSuite  # noqa: E402
from voxgran.testing.shape_families import ShapeFamilySuite  # noqa: E402

__all__ = ["ContainerSuite", "EngineSuite", "MeasureSuite", "PackingMethodSuite", "ShapeFamilySuite"]
