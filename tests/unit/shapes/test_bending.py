"""Grains that bend: the energies of fields, the bars that stay round, and triangles that fold."""

from dataclasses import replace

import netCDF4
import numpy as np
import pytest

import voxgran as vg
from benchmarks.grains import twins
from voxgran._base.errors import FileFormatError
from voxgran._base.seeds import stream
from voxgran.shapes.describing.curvature import edges_of_mesh
from voxgran.shapes.learning import bend
from voxgran.shapes.learning.bend import bent, displaced, monomials, soft_fields, unfolded
from voxgran.shapes.learning.learn import _made_oval
from voxgran.shapes.learning.sample import meshed
from voxgran.shapes.learning.warp import mapped
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.repairing.diagnose import refuse_dirty

#: fine enough that strained meshes have no sharp edges
RINGS = [vg.make_shape("torus", aspect=0.25 + k / 60, tolerance=0.005) for k in range(12)]


GRAINS = twins.rings_with_rods(12, 3)


def field_of(*rows: tuple[tuple[int, int, int], int, float]) -> np.ndarray:
    """Return the coefficients (20, 3) of a displacement from powers, axis and value."""
    field = np.zeros((20, 3))
    for powers, axis, value in rows:
        field[(powers == bend.POWERS).all(axis=1).argmax(), axis] = value
    return field


def test_slopes_of_monomials_are_their_differences():
    points, step = stream(0, "points").normal(0, 1, (30, 3)), 1e-6
    slopes = monomials(points)[1]
    for axis in range(3):
        move = step * np.eye(3)[axis]
        twin = (monomials(points + move)[0] - monomials(points - move)[0]) / (2 * step)
        assert slopes[axis] == pytest.approx(twin, abs=1e-7)


def test_energies_are_those_of_strains_and_of_angles():
    mesh, draw = meshed(RINGS[3]).geometry, stream(1, "energies")
    points, faces, field = mesh.vertices, mesh.corners.astype(np.int64), 1e-5 * draw.normal(0, 1, (20, 3))
    values, slopes = monomials(points)
    share = draw.random(len(points))
    # the gradient (n, 3, 3) of the displacement, axis first
    gradient = np.einsum("ank,kb->nab", slopes, field)
    strain = (gradient + gradient.transpose(0, 2, 1)) / 2
    flat = field.T.ravel()
    assert flat @ bend._strains(slopes, share) @ flat == pytest.approx(share @ (strain**2).sum(axis=(1, 2)))
    one, two = (edges_of_mesh(x, faces) for x in (points - values @ field, points + values @ field))
    change = ((two.angle - one.angle) / 2) ** 2 @ edges_of_mesh(points, faces).length
    turned = flat @ bend._turned(points, faces, values) @ flat
    assert turned == pytest.approx(change / edges_of_mesh(points, faces).length.sum(), rel=1e-4)
    for rigid in (field_of(((0, 0, 0), 0, 1.0)), field_of(((1, 0, 0), 1, 1.0), ((0, 1, 0), 0, -1.0))):
        flat = rigid.T.ravel()
        for matrix in (bend._strains(slopes, share), bend._turned(points, faces, values)):
            assert flat @ matrix @ flat == pytest.approx(0.0, abs=1e-12 * np.abs(matrix).max())


@pytest.mark.slow
def test_bars_that_bend_stay_round_and_stretched_ones_do_not():
    bending = vg.learn_shapes(GRAINS, method="bend")
    # in standard deviations of the sample
    assert abs(_made_oval(bending, 1)) < 1.5
    assert _made_oval(replace(bending, method="warp"), 1) > 4
    for grain in bending.sample(4):
        donor = bending.shapes[grain.record["donor"]]
        moved = displaced(donor.geometry, grain.record["bend"]) - donor.vertices
        # the mean square is that over the surface
        corners = (moved**2).sum(axis=1)[donor.faces].mean(axis=1)
        area = np.linalg.norm(np.cross(*np.diff(donor.vertices[donor.faces], axis=1).transpose(1, 0, 2)), axis=1)
        assert np.sqrt(corners @ area / area.sum()) == pytest.approx(0.05 * donor.diameter, rel=0.15)


@pytest.mark.slow
def test_round_bars_bend_and_other_grains_are_warped():
    model = vg.learn_shapes(GRAINS)
    assert repr(model) == "ShapeModel('bend', grains=12, strength=0.05)"
    assert vg.learn_shapes(vg.make_shapes("solid_union", count=12)).method == "warp"
    grains = model.sample(12, seed=2)
    assert grains == model.sample(12, seed=2)
    mirrored = 0
    for grain in grains:
        donor = model.shapes[grain.record["donor"]].geometry
        made = mapped(displaced(donor, grain.record["bend"]), grain.record["map"])
        assert made == pytest.approx(grain.vertices, abs=1e-12)
        mirrored += np.linalg.det(grain.record["map"][:3, :3]) < 0
        moments = np.diag(grain.inertia)
        assert grain.inertia == pytest.approx(np.diag(moments), abs=1e-9 * moments.max())
        assert grain.geometry.centroid == pytest.approx(np.zeros(3), abs=1e-12)
    assert 1 < mirrored < 11


def test_bars_with_cut_ends_bend_too():
    rods = []
    for k in range(12):
        # rims are sharp, and vertices lie along the bar
        angle, along = np.meshgrid(np.arange(20) * np.pi / 10, np.linspace(-1, 1, 20))
        side = np.stack([np.cos(angle), np.sin(angle), (8 + k) * along], axis=-1).reshape(-1, 3)
        a = np.arange(380)
        b = a // 20 * 20 + (a + 1) % 20
        caps = [(400, (j + 1) % 20, j) for j in range(20)] + [(401, 380 + j, 380 + (j + 1) % 20) for j in range(20)]
        faces = np.concatenate([np.stack([a, b, b + 20], axis=1), np.stack([a, b + 20, a + 20], axis=1), caps])
        points = np.concatenate([side, side.reshape(20, 20, 3)[[0, -1]].mean(axis=1)])
        rods.append(vg.Shape.of(Mesh(points, faces), name="rod"))
    assert vg.learn_shapes(rods).method == "bend"


def test_files_keep_that_grains_bend(tmp_path):
    model = vg.learn_shapes(RINGS, np.linspace(1, 2, 12), method="bend", strength=0.03)
    model.save(tmp_path / "rings.nc")
    read = vg.ShapeModel.load(tmp_path / "rings.nc")
    assert (read.method, read.strength) == ("bend", 0.03)
    assert read.sample(4, seed=1) == model.sample(4, seed=1)
    with netCDF4.Dataset(tmp_path / "rings.nc", "a") as file:
        file.method = "twist"
    with pytest.raises(FileFormatError, match=r"makes grains by 'twist': known are warp, bend; learn it again"):
        vg.ShapeModel.load(tmp_path / "rings.nc")


@pytest.mark.slow
def test_bent_grains_are_closed_and_do_not_cross_themselves():
    model = vg.learn_shapes(GRAINS, method="bend")
    for grain in model.sample(6):
        refuse_dirty(grain.vertices, grain.faces, grain.name)
        assert grain.volume > 0


def test_displacements_are_halved_until_no_surface_crosses_itself():
    # thin necks, and a strength at which a third of the grains would cross themselves
    mesh = meshed(vg.make_shape("solid_union")).geometry
    soft, halved = soft_fields(mesh), 0
    for k in range(10):
        made, field = bent(mesh, soft, 0.15, stream(k, "necks"))
        refuse_dirty(made.vertices, made.corners.astype(np.int64), "necks")
        parts = stream(k, "necks").normal(size=len(soft.energies)) * (soft.energies[0] / soft.energies) ** bend.STIFF
        whole = np.tensordot(0.3 * parts / np.linalg.norm(parts), soft.fields, axes=1)
        times = np.log2(np.linalg.norm(whole) / np.linalg.norm(field))
        assert times == pytest.approx(round(times), abs=1e-9)
        halved += times > 0.5
    assert 0 < halved < 10


def test_few_vertices_bend_too():
    mesh = vg.make_shape("box", lengths=(3, 1, 1))
    mesh = Mesh(mesh.vertices, mesh.faces)
    made, _ = bent(mesh, soft_fields(mesh), 0.05, stream(0, "box"))
    refuse_dirty(made.vertices, made.corners.astype(np.int64), "box")


def test_narrow_triangles_are_turned_where_they_fold():
    # a long bar, on the upper side of which a vertex lies next to the diagonal
    bar = vg.make_shape("box", lengths=(4, 1, 0.2))
    points, faces = bar.vertices, bar.faces
    top = np.flatnonzero((points[faces][:, :, 2] > 0).all(axis=1))
    (a, b), c = np.intersect1d(*faces[top]), 0
    middle = len(points)
    one = faces[top[0]]
    c = int(np.setdiff1d(one, [a, b])[0])
    points = np.concatenate([points, (0.4995 * (points[a] + points[b]) + 0.001 * points[c])[None]])
    parts = [np.where(one == corner, middle, one) for corner in (a, b, c)]
    faces = np.concatenate([np.delete(faces, top[0], axis=0), parts])
    refuse_dirty(points, faces, "bar")
    assert unfolded(points, faces, points) == pytest.approx(faces)
    hollow = points + [0, 0, 0.02] * (4 - points[:, :1] ** 2)
    turned = unfolded(hollow, faces, points)
    assert (turned != faces).any()
    refuse_dirty(hollow, turned, "bar")
    assert bend._fold(edges_of_mesh(hollow, turned)) < bend._fold(edges_of_mesh(hollow, faces))
