import numpy as np

from benchmarks.images.voxelize import SHARES, bench_shapes, measure_peers, measure_rows
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sphere
from voxgran.voxels.occupy import BACKENDS


def test_rows_hold_seconds_and_errors_of_each_backend():
    vertices, faces, _ = sphere(2)
    turn = random_rotations(stream(14, "turn"), 1)[0]
    shape = Shape.of(Mesh(vertices, faces), name="sphere").rotated(turn)
    rows = measure_rows([shape], (8, 32), 2)
    assert dict(rows.sizes) == {"shape": 1, "backend": len(BACKENDS) + 1, "resolution": 2}
    assert (rows.seconds > 0).all()
    errors = rows.volume_error.sel(shape="sphere", backend=list(BACKENDS)).values
    # all backends give the same voxels, so the same errors
    assert np.ptp(errors, axis=0).max() == 0
    assert (errors[:, 1] < errors[:, 0]).all()
    assert (rows.volume_error.sel(backend=SHARES) < 1e-13).all()


def test_at_least_five_shapes_real_bodies_among_them():
    names = [shape.name for shape in bench_shapes()]
    assert len(names) >= 5
    assert "aligned box" in names
    assert any(name.startswith("eros") for name in names)


def test_peers_give_the_voxels_that_voxgran_gives():
    rows = measure_peers((48,))
    assert {name for _, name, _, _ in rows} >= {"PyVista mask", "VTK stencil", "Open3D ray columns", "Open3D occupancy"}
    assert all(wrong <= 2 and seconds >= 0 for _, _, seconds, wrong in rows)
