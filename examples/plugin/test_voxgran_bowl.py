"""The container keeps what every container of voxgran must keep."""

from voxgran_bowl import Bowl

from voxgran.testing import ContainerSuite


class TestBowl(ContainerSuite):
    """The conformance suite."""

    def container(self):
        """Return a bowl."""
        return Bowl(radius=3.0, depth=2.0)
