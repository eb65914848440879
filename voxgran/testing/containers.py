"""What every container must keep, as a class of tests to derive from."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from voxgran._base.arrays import Floats
from voxgran._base.errors import PackingWarning
from voxgran._base.seeds import stream
from voxgran.contacts.verify import verify
from voxgran.containers.model import UNKNOWN, Container, boundary_of, check_container, make_container
from voxgran.io.files import load, save
from voxgran.packing.method import packing_methods
from voxgran.packing.pack import pack
from voxgran.shapes.family import make_shape

#: random points in the bounds
POINTS = 40_000


class ContainerSuite:
    """Tests of one container; derive from it in a test file and return the container.

    Examples
    --------
    >>> import voxgran as vg
    >>> from voxgran.testing import ContainerSuite
    >>> class TestSphere(ContainerSuite):
    ...     def container(self):
    ...         return vg.Sphere(2.0)
    """

    def container(self) -> Container:
        """Return the container.

        Raises
        ------
        NotImplementedError
            Where the class of tests does not return one.
        """
        raise NotImplementedError

    def points(self) -> Floats:
        """Return random points within the bounds, (n, 3)."""
        lower, upper = self.container().bounds
        return stream(0, "points of the container").uniform(lower, upper, (POINTS, 3))

    def test_it_has_all_that_a_container_needs(self) -> None:
        """Attributes, and a mapping of JSON-able values that names the kind."""
        container = self.container()
        check_container(container)
        assert container.dimension in (2, 3)
        assert container.bounds.shape == (2, 3)
        kind = container.kind
        assert json.loads(json.dumps(container.to_mapping()))["kind"] == kind

    def test_the_volume_is_that_of_the_points_inside(self) -> None:
        """The share of random points with a negative distance gives the volume, within five standard errors."""
        container = self.container()
        if all(container.periodic[: container.dimension]):
            pytest.skip("there is no wall")
        lower, upper = container.bounds
        whole = float(np.prod((upper - lower)[: container.dimension]))
        share = float((container.signed_distance(self.points()) < 0).mean())
        error = 5 * np.sqrt(max(share * (1 - share), 1 / POINTS) / POINTS)
        assert container.volume / whole == pytest.approx(share, abs=error)

    def test_the_distance_changes_by_no_more_than_the_way(self) -> None:
        """A step of some length changes the distance from the wall by at most that length."""
        container, points = self.container(), self.points()
        step = stream(0, "steps").normal(scale=0.01, size=points.shape)
        step[:, container.dimension :] = 0.0
        step *= (container.bounds[1] - container.bounds[0]).max()
        with np.errstate(invalid="ignore"):
            change = np.abs(container.signed_distance(points + step) - container.signed_distance(points))
        way = np.linalg.norm(step, axis=1)
        assert not (change > way * (1 + 1e-9) + 1e-12).any()

    def test_vertices_of_the_mesh_lie_on_the_wall(self) -> None:
        """Pictures and files show the wall: no vertex is farther from it than a hundredth of the largest extent."""
        container = self.container()
        vertices, faces = container.mesh()
        assert len(faces)
        assert faces.max() < len(vertices)
        if container.dimension == 3 and not any(container.periodic):
            size = (container.bounds[1] - container.bounds[0]).max()
            assert np.abs(container.signed_distance(vertices)).max() <= 0.01 * size

    def test_scaling_scales_all_lengths(self) -> None:
        """Bounds, volume and distances of the container times two."""
        container, points = self.container(), self.points()[:100]
        twice = container.scaled(2.0)
        np.testing.assert_allclose(twice.bounds, 2 * container.bounds, rtol=1e-14)
        assert twice.volume == pytest.approx(2**container.dimension * container.volume, rel=1e-12)
        with np.errstate(invalid="ignore"):
            np.testing.assert_allclose(
                twice.signed_distance(2 * points), 2 * container.signed_distance(points), rtol=1e-9, atol=1e-12
            )

    def test_it_is_saved_and_loaded(self, tmp_path: Path) -> None:
        """A packing in it is saved and loaded with the same container, which its mapping makes again by its kind."""
        container = self.container()
        grain = make_shape("sphere" if container.dimension == 3 else "disk")
        save(pack(grain, container, method="digital", count=0), tmp_path / "empty.vtp")
        again = load(tmp_path / "empty.vtp").container
        for one in (again, make_container(json.loads(json.dumps(container.to_mapping())))):
            assert type(one) is type(container)
            assert one.to_mapping() == container.to_mapping()

    @pytest.mark.parametrize("method", ["rsa", "digital"])
    def test_grains_stay_inside(self, method: str) -> None:
        """Methods that know the walls in closed form pack into it where it gives them; the voxel methods always do."""
        container = self.container()
        if method == "rsa" and boundary_of(container) is UNKNOWN:
            pytest.skip("walls in closed form are needed")
        assert method in packing_methods()
        size = 0.2 * float((container.bounds[1] - container.bounds[0])[: container.dimension].min())
        grain = make_shape("sphere" if container.dimension == 3 else "disk", diameter=size)
        with warnings.catch_warnings(action="ignore", category=PackingWarning):
            packing = pack(grain, container, method=method, count=5)
        assert packing.count > 0
        assert verify(packing).escaped == 0
