"""The packing method keeps what every packing method of voxgran must keep."""

from voxgran.testing import PackingMethodSuite


class TestCubic(PackingMethodSuite):
    """The conformance suite, with a gap between the grains."""

    method = "cubic"
    parameters = {"gap": 0.05}  # noqa: RUF012
