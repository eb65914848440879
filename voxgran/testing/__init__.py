"""Tests for those who extend voxgran, with pytest: :class:`PackingMethodSuite` is what every packing method must pass.

pytest is needed by nothing else in voxgran and is imported with this package only.
"""

import pytest

# so that a failed assertion shows the values compared, as in a test file
pytest.register_assert_rewrite("voxgran.testing.packing_methods")

from voxgran.testing.packing_methods import PackingMethodSuite  # noqa: E402

__all__ = ["PackingMethodSuite"]
