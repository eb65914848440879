"""The interactive view: what a page carries of the grains is what the packing is, and nothing comes from elsewhere."""

import base64
import dataclasses
import gzip
import json
import re
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from kit import lattice
from scipy.spatial.transform import Rotation

import voxgran as vg
from voxgran._base.errors import MissingLibraryError
from voxgran._base.seeds import stream
from voxgran.contacts.forces import ContactForces
from voxgran.report import view
from voxgran.report.colors import coloring, gradient
from voxgran.report.creases import creased
from voxgran.report.scenes import drawn_surface
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import sphere

pytestmark = pytest.mark.usefixtures("jagged_pictures")


def unpacked(text):
    """Return head and arrays of the data of a view, as the page's script reads them."""
    content = gzip.decompress(base64.b64decode(text))
    size = int.from_bytes(content[:4], "little")
    head = json.loads(content[4 : 4 + size])
    arrays = {}
    for name, one in head["arrays"].items():
        count = int(np.prod(one["shape"]))
        start = 4 + size + one["at"]
        assert start % 4 == 0
        arrays[name] = np.frombuffer(content, one["type"], count, start).reshape(one["shape"])
    return head, arrays


def corners_of(head, arrays):
    """Return the corners (m, 3, 3) of the triangles of each grain, in the unit of the packing, by its number."""
    first_vertex = np.concatenate([[0], np.cumsum(arrays["vertex_count"], dtype=np.int64)])
    first_face = np.concatenate([[0], np.cumsum(arrays["face_count"], dtype=np.int64)])
    found = {}
    for g, number in enumerate(arrays["grain"].tolist()):
        s = int(arrays["shape"][g])
        body = arrays["vertices"][first_vertex[s] : first_vertex[s + 1]] * (arrays["reach"][s] / 32767.0)
        w, *xyz = arrays["orientation"][g].astype(float)
        turned = Rotation.from_quat([*xyz, w]).apply(body) * arrays["scale"][g] + arrays["position"][g]
        corners = turned[arrays["faces"][first_face[s] : first_face[s + 1]]]
        found[number] = corners * head["length"] + np.array(head["middle"])
    return found


def data_of(path):
    """Return the data of all packings of a page."""
    texts = re.findall(r'<script type="application/gzip" class="view-data"[^>]*>([^<]*)</script>', path.read_text())
    return [unpacked(text) for text in texts]


@pytest.mark.parametrize(("length", "place"), [(1.0, 0.0), (1e-6, 3e-5), (1e6, -1e8)])
def test_the_page_places_the_surfaces_where_the_grains_are(packing, length, place):
    block = packing.shapes[1]
    moved = vg.Packing.of(
        [
            vg.Shape.of(Primitive("sphere", (0.5 * length,)), name="s"),
            vg.Shape.from_mesh(length * block.vertices, block.faces),
        ],
        vg.Box((4 * length,) * 3, origin=(place,) * 3),
        position=packing.position * length + place,
        orientation=packing.orientation,
        scale=packing.scale,
        shape_id=packing.shape_id,
    )
    head, arrays = unpacked(view.views_of({"": moved})["packings"][0].data)
    found = corners_of(head, arrays)
    assert sorted(found) == list(range(48))
    for grain, corners in found.items():
        shape = moved.shapes[moved.shape_id[grain]]
        vertices, faces = drawn_surface(shape, view.MOST)
        true = vertices @ moved.matrices[grain].T * moved.scale[grain] + moved.position[grain]
        assert np.abs(corners - true[faces]).max() < 1e-4 * length


def test_arrays_of_all_lengths_begin_where_the_head_says():
    arrays = {"a": np.arange(5, dtype=np.int16), "b": np.arange(3, dtype=np.uint16), "c": np.arange(2.0, dtype="f4")}
    content = gzip.compress(view.encoded({"name": "\u00b5m"}, arrays))
    head, found = unpacked(base64.b64encode(content))
    assert head["name"] == "\u00b5m"
    assert all((found[name] == array).all() for name, array in arrays.items())


def test_values_and_contacts_are_those_of_the_packing(packing):
    head, arrays = unpacked(view.views_of({"": packing})["packings"][0].data)
    assert [color["name"] for color in head["colors"]] == ["diameter", "height", "shape", "coordination", "distance"]
    for color, values in zip(head["colors"], arrays["values"], strict=True):
        found = coloring(packing, color["name"])
        assert values == pytest.approx(found.values, rel=1e-6)
        assert (color["label"], color["unit"]) == (found.label, found.unit)
    counted = np.bincount(arrays["contacts"].ravel(), minlength=48)
    assert counted.tolist() == coloring(packing, "coordination").values.tolist()
    assert counted.sum() > 20
    assert head["shapes"] == ["sphere", "<block> & co"]


def test_contacts_that_are_known_are_not_found_again(packing, monkeypatch):
    vg.measure(packing, which="coordination")
    monkeypatch.setattr("voxgran.packing.model.find_contacts", None)
    assert view.views_of({"": packing}) is not None


def test_heights_are_against_gravity(packing):
    assert coloring(packing, "height").values == pytest.approx(packing.position[:, 2])
    sideways = dataclasses.replace(packing, gravity=(1.0, 0.0, 0.0))
    assert coloring(sideways, "height").values == pytest.approx(4 - packing.position[:, 0])


def test_heights_in_the_plane_are_along_y(flat):
    assert coloring(flat, "height").values.tolist() == [1, 1, 2]


@pytest.mark.parametrize("group", [7, 1000])
def test_the_nearest_centroids_are_those_of_all_distances(group, monkeypatch):
    monkeypatch.setattr("voxgran.report.colors.GROUP", group)
    packing = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 6), periodic="xy"), "rsa", count=40, seed=1)
    packing = packing[packing.position[:, 2] < 3] + packing[packing.position[:, 2] > 5.3]
    steps = packing.position[:, None] - packing.position
    steps[..., :2] -= 4 * np.round(steps[..., :2] / 4)
    away = np.linalg.norm(steps, axis=2) + np.diag(np.full(packing.count, np.inf))
    assert coloring(packing, "distance").values == pytest.approx(away.min(axis=1), rel=1e-12)


def test_force_is_a_colour_where_it_is_known(flat):
    forces = ContactForces(
        i=[0], j=[-1], point=[[1, 0, 0]], normal=[[0, -1, 0]], force=[[0, -2, 0]], gap=[0], residual=[0.0] * 3,
        rattler=[False] * 3,
    )  # fmt: skip
    head, arrays = unpacked(view.views_of({"": dataclasses.replace(flat, forces=forces)})["packings"][0].data)
    assert [color["name"] for color in head["colors"][-2:]] == ["force", "residual"]
    assert arrays["values"][-2:].tolist() == [[2, 0, 0], [0, 0, 0]]


def test_flat_packings_lie_in_the_plane(flat):
    found = view.views_of({"": flat})
    assert found["flat"]
    head, arrays = unpacked(found["packings"][0].data)
    corners = np.concatenate(list(corners_of(head, arrays).values()))
    assert np.ptp(corners[..., 2]) == 0
    assert head["dimension"] == 2
    # the outline is that of the rectangle
    lines = arrays["lines"] * head["length"] + np.array(head["middle"])
    assert lines.reshape(-1, 3).min(axis=0) == pytest.approx([0, 0, 0], abs=1e-6)
    assert lines.reshape(-1, 3).max(axis=0) == pytest.approx([4, 3, 0], abs=1e-6)


@pytest.mark.parametrize(
    "container", [vg.Box((4, 4, 4)), vg.Cylinder(2, 4), vg.Sphere(2), vg.ClosedMesh(vg.Shape.from_mesh(*sphere(3)[:2]))]
)
def test_every_container_has_an_outline(container):
    lines = view.outline(container)
    low, high = container.bounds
    reach = np.array([lines.reshape(-1, 3).min(axis=0), lines.reshape(-1, 3).max(axis=0)])
    assert reach == pytest.approx(np.array([low, high]), abs=0.02 * np.ptp(container.bounds))
    assert len(lines) >= 12


def test_a_box_is_drawn_by_its_twelve_edges():
    lines = view.outline(vg.Box((4, 4, 4)))
    assert np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum() == pytest.approx(48)


@pytest.mark.parametrize(
    ("family", "parameters", "added"),
    [
        # three sides meet in each corner of a cube, five in each of an icosahedron, two along the rims of a cylinder
        ("box", {}, 16),
        ("platonic", {"solid": "icosahedron"}, 48),
        ("cylinder", {}, None),
        ("sphere", {}, 0),
        ("ellipsoid", {"semi_axes": (1, 1, 3)}, 0),
    ],
)
@pytest.mark.parametrize("most", [1000, 40])
def test_surfaces_are_split_along_sharp_edges_only(family, parameters, added, most):
    shape = vg.make_shape(family, **parameters)
    vertices, faces = drawn_surface(shape, most)
    split, triangles = creased(shape, vertices, faces)
    assert split[triangles] == pytest.approx(vertices[faces], abs=0)
    rim = np.unique(np.round(vertices[np.abs(np.abs(vertices[:, 2]) - np.abs(vertices[:, 2]).max()) < 1e-6], 9), axis=0)
    assert len(split) - len(vertices) == (len(rim) if added is None else added)


def test_normals_at_the_vertices_of_a_cube_are_those_of_its_sides():
    shape = vg.make_shape("box")
    corners, faces = creased(shape, shape.vertices, shape.faces)
    normal = np.cross(corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]])
    around = np.zeros_like(corners)
    for k in range(3):
        np.add.at(around, faces[:, k], normal / np.linalg.norm(normal, axis=1, keepdims=True))
    assert np.sort(np.abs(around / np.linalg.norm(around, axis=1, keepdims=True)), axis=1) == pytest.approx(
        np.tile([0.0, 0.0, 1.0], (24, 1)), abs=1e-12
    )


def many(count, shapes, edge, *, scale=0.9):
    position = lattice(edge, edge, -(-count // edge**2))[:count]
    size = position.max(axis=0) + 0.5
    return vg.Packing.of(
        shapes,
        vg.Box(tuple(size)),
        position=position,
        scale=np.full(count, scale),
        shape_id=np.arange(count) % len(shapes),
    )


def rough(count):
    """Return shapes of 1,280 triangles, all different."""
    directions, faces, _ = sphere(3)
    generator = stream(1, "rough")
    return [
        vg.Shape.from_mesh(directions * (0.4 + 0.05 * generator.random((len(directions), 1))), faces, name=f"r{k}")
        for k in range(count)
    ]


@pytest.mark.slow
def test_a_page_of_1000_shapes_of_1000_triangles_has_at_most_8_megabytes(tmp_path, monkeypatch):
    # plots take less than 0.5 MB, but the roundness of 1,000 shapes most of a minute
    monkeypatch.setattr("voxgran.report.page.figures_of", lambda packing, statistics: [])
    # apart, so that no time goes into contacts
    packing = many(1000, rough(1000), 10, scale=0.7)
    assert min(len(shape.faces) for shape in packing.shapes) >= 1000
    vg.save_report(packing, tmp_path / "p.html")
    assert (tmp_path / "p.html").stat().st_size <= 7_500_000
    assert "reduced to about 240 triangles for this view only" in (tmp_path / "p.html").read_text()


def test_surfaces_are_reduced_and_the_page_says_so():
    packing = many(12, rough(12), 3)
    found = view._view("", packing, 12 * 200)
    _, arrays = unpacked(found.data)
    assert arrays["face_count"].max() <= 200
    assert arrays["face_count"].min() > 50
    assert found.note == "Surfaces are reduced to about 200 triangles for this view only."
    assert view._view("", many(2, [vg.make_shape("box")], 2), 10_000).note == ""


def test_a_large_packing_is_shown_in_part_and_the_page_says_which(monkeypatch):
    monkeypatch.setattr("voxgran.report.view.GRAINS", 100)
    packing = many(343, [vg.make_shape("sphere")], 7)
    found = view._view("", packing, view.TRIANGLES)
    head, arrays = unpacked(found.data)
    assert len(arrays["grain"]) == 100
    assert "shows 100 of 343 grains, those nearest to the middle along y" in found.note
    away = np.abs(packing.position[:, 1] - packing.container.bounds.mean(axis=0)[1])
    assert away[arrays["grain"]].max() <= np.delete(away, arrays["grain"]).min()
    assert set(corners_of(head, arrays)) == set(arrays["grain"].tolist())


def test_twenty_thousand_grains_cost_little():
    packing = many(20_000, [vg.make_shape("sphere")], 27)
    view.viewer()
    coloring(packing, "coordination")
    began = time.process_time()
    found = view.views_of({"": packing})
    assert time.process_time() - began < 5
    assert len(found["packings"][0].data) < 2_000_000
    assert unpacked(found["packings"][0].data)[1]["face_count"].tolist() == [20]


def test_no_grains_no_view(tmp_path):
    empty = vg.Packing.of([vg.make_shape("sphere")], vg.Box((1, 1, 1)), position=np.zeros((0, 3)))
    assert view.views_of({"": empty}) is None
    vg.save_report(empty, tmp_path / "p.html")
    assert "<script" not in (tmp_path / "p.html").read_text()


def test_the_page_has_the_view_beside_its_pictures(packing, tmp_path):
    vg.save_report(packing, tmp_path / "p.html", color_by="shape")
    text = (tmp_path / "p.html").read_text()
    assert text.index("<img") < text.index('id="view"')
    assert "<noscript><p" in text
    assert 'id="view-body" hidden' in text
    # all that a browser could fetch is in the page; names stand in no markup
    assert re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', text) == []
    assert re.findall(r"https?://(?!www\.w3\.org)", text) == []
    settings = json.loads(re.search(r'id="view-settings">(.*?)</script>', text).group(1))
    assert settings["color"] == "shape"
    assert settings["gradient"] == gradient()
    library = re.search(r'id="view-viewer">([^<]*)</script>', text).group(1)
    assert b"plotly.js v" in gzip.decompress(base64.b64decode(library))[:100]


def test_without_plotly_the_error_says_what_to_install(monkeypatch):
    def missing(name):
        raise MissingLibraryError(f"{name} cannot be loaded: install it with 'pip install {name}'")

    view.viewer.cache_clear()
    monkeypatch.setattr("voxgran.report.view.load", missing)
    with pytest.raises(MissingLibraryError, match="pip install plotly"):
        view.viewer()


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_a_comparison_has_a_view_of_each_group(packing, tmp_path):
    smaller = dataclasses.replace(packing, scale=0.9 * packing.scale)
    vg.save_comparison({"one": [packing], "<two>": smaller}, tmp_path / "c.html", which=["density"])
    data = data_of(tmp_path / "c.html")
    assert len(data) == 2
    assert "<option>one</option><option>&lt;two&gt;</option>" in (tmp_path / "c.html").read_text()
    assert data[1][1]["scale"] == pytest.approx(0.9 * data[0][1]["scale"])
    vg.save_comparison({"a": packing, "b": smaller}, tmp_path / "d.html", which=["density"], interactive=False)
    assert "<script" not in (tmp_path / "d.html").read_text()


def test_scale_of_colours_is_lighter_toward_larger_values():
    """Lightness alone tells the colours apart: they need neither red nor green."""
    colors = np.array([[int(color[k : k + 2], 16) for k in (1, 3, 5)] for color in gradient()]) / 255
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    lightness = 116 * np.cbrt(np.maximum(linear @ [0.2126, 0.7152, 0.0722], 0.008856)) - 16
    assert np.diff(lightness).min() > 5


def test_a_notebook_turns_the_packing_where_trame_is_installed(packing, monkeypatch):
    pyvista = pytest.importorskip("pyvista")
    asked = []
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    monkeypatch.setattr(pyvista.Plotter, "show", lambda self, **options: asked.append((self, options)) or "widget")
    backends = [SimpleNamespace(name=name) for name in ("client", "html", "trame")]
    monkeypatch.setattr(pyvista, "registered_jupyter_backends", lambda: backends, raising=False)
    monkeypatch.setattr(pyvista.global_theme, "_jupyter_backend", None)
    assert packing.plot(color_by="height") == "widget"
    plotter, options = asked.pop()
    assert options == {"jupyter_backend": "trame", "return_viewer": True}
    assert len(plotter.actors) >= 2
    plotter.close()
    for chosen, there in (("static", backends), ("trame", []), (None, [])):
        monkeypatch.setattr(pyvista, "registered_jupyter_backends", lambda there=there: there)
        monkeypatch.setattr(pyvista.global_theme, "_jupyter_backend", chosen)
        assert vg.plot(packing, window=(200, 100)).size == (200, 100)
    assert asked == []


def test_a_notebook_of_an_older_pyvista_turns_the_packing(packing, monkeypatch):
    pyvista = pytest.importorskip("pyvista")
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    monkeypatch.setattr(pyvista.Plotter, "show", lambda self, **options: options["jupyter_backend"])
    monkeypatch.delattr(pyvista, "registered_jupyter_backends", raising=False)
    monkeypatch.setattr(pyvista.global_theme, "_jupyter_backend", "server")
    monkeypatch.setattr("voxgran.report.notebook.find_spec", lambda name: name)
    assert packing.plot() == "server"
    monkeypatch.setattr("voxgran.report.notebook.find_spec", lambda name: None)
    assert vg.plot(packing, window=(200, 100)).size == (200, 100)
