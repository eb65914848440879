"""The container keeps what every container of voxgran must keep."""

from voxgran_hopper import Hopper

from voxgran.testing import ContainerSuite


class TestHopper(ContainerSuite):
    """The conformance suite."""

    def container(self):
        """Return a hopper."""
        return Hopper(radius=3.0, outlet=1.0)
