"""The benchmark of contact tests: peers move as the walk does, and errors are those of closed forms."""

import numpy as np
import pytest

import voxgran as vg
from benchmarks.encounter import Encounter
from benchmarks.packing import contact
from benchmarks.peers import contact as peers


@pytest.mark.slow
def test_peers_accept_the_same_attempts():
    """Both programs move the same grains to the same places."""
    problem, state = contact.moving_task(vg.make_shape("box", lengths=(1.1, 0.9, 0.7)), 0.3, "kdtree", count=20)
    setting = contact.precomputed_of(problem, state)
    arrays = [state.arrays[name] for name in ("position", "orientation", "step")]
    lower, upper = (np.array(corner, dtype=float) for corner in problem.container.bounds)
    rest = {"lower": lower, "upper": upper, "distance": 2 * float(setting.extent[0, 1]), "longest": 0.05}
    one, other = (peers.Grains(problem.points(0, 0.3), *arrays, **rest) for _ in range(2))
    drawn = contact._draw_moves(np.random.Generator(np.random.Philox(1)), 20, 0.7, one.radius, 600)
    moved = [peers.tree_moves(one)(*drawn), peers.grid_moves(other)(*drawn)]
    assert moved[0] == moved[1]
    assert 100 < moved[0] < 600
    assert np.allclose(one.position, other.position, rtol=0, atol=1e-12)
    assert np.allclose(np.abs((one.orientation * other.orientation).sum(axis=1)), 1.0, rtol=0, atol=1e-12)
    assert np.abs(one.position - state.arrays["position"]).max() > 0.02


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(contact, "SECONDS", 0.01)
    monkeypatch.setattr(contact, "APPROACHES", 2)
    monkeypatch.setattr(contact, "GRAINS", 12)
    monkeypatch.setattr(contact, "measure_beds", lambda: [("walls", 0.5, "none", 100, 1.0, 0.5, 0.01)])
    monkeypatch.setattr(contact, "SPACINGS", {"sphere": (0.4,)})
    monkeypatch.setattr(contact, "ACCURACY_SPACINGS", (0.4, 0.3))
    monkeypatch.setattr(contact, "bodies", lambda: {"sphere": vg.make_shape("sphere")})
    speed = contact.measure_speed(contact.bodies(), {"sphere": (0.4,)})
    assert {row[2] for row in speed} == {*contact.TESTS, "SciPy cKDTree", "numba grid"}
    assert all(row[3] > 0 and 0 < row[4] < 1 for row in speed)
    files = contact.run(tmp_path)
    assert [path.name for path in files] == [
        "contact_speed.csv",
        "contact_accuracy.csv",
        "contact_beds.csv",
        "contact.svg",
    ]
    lines = files[1].read_text().splitlines()
    assert lines[0].startswith("shape,test,points,spacing,mean_error")
    assert len(lines) == 1 + 2 * len(contact.TESTS)


def test_least_gap_is_that_of_manifold3d():
    """Two spheres as meshes, apart along x, and pushed into each other."""
    sphere = vg.make_shape("sphere")
    mesh = vg.Shape.from_mesh(sphere.vertices, sphere.faces)
    for apart in (1.15, 0.96):
        gap = contact._least_gap(mesh, mesh.vertices, mesh.vertices, np.array([apart, 0.0, 0.0]), np.array([1.0, 0, 0]))
        assert gap == pytest.approx(apart - 1.0, abs=2e-3)


def test_minkowski_difference_gives_the_gap_of_boxes():
    """Cubes that come face to face along x stop at their spacing."""
    cube = vg.make_shape("box", aspect=(1, 1, 1))
    way, turns = np.array([1.0, 0, 0]), np.array([[1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    pair = Encounter(cube, cube, contact=contact.TESTS["kdtree"][0], spacing=0.2)
    offset, edge = pair.first_contact(way, turns=turns), cube.volume ** (1 / 3)
    assert contact.true_gap(cube, turns, way, offset) == pytest.approx(offset[0] - edge, abs=1e-12)
    assert 0 < offset[0] - edge <= pair.allowance + 1e-12


@pytest.mark.slow
def test_beds_of_each_bias_and_vibration():
    rows = contact.measure_beds(300, (1, 2), (20,))
    assert (
        len({row[:4] for row in rows})
        == len(rows)
        == len(contact.BOXES) * (1 + len(contact.BIASES) * len(contact.SHAKEN))
    )
    assert all(np.isfinite(row[5:]).all() for row in rows)
