"""No test of a benchmark looks at its figure."""

import pytest


@pytest.fixture(autouse=True)
def jagged(jagged_pictures):
    """Draw figures without room for their labels, which takes half the time of a figure."""
