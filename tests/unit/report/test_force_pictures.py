"""Forces on a page: force chains, colours by force, their distribution, and what the headline says of a bed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from kit import column
from matplotlib.figure import Figure

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.contacts.forces import ContactForces
from voxgran.report import facts
from voxgran.report.colors import coloring, colors_of
from voxgran.report.figures import figures_of
from voxgran.report.force_chains import ROD, add_contacts, picture_forces, tubes
from voxgran.report.page import save_report
from voxgran.report.plots import plot_forces
from voxgran.report.scenes import picture_packing
from voxgran.report.stage import stage_of
from voxgran.shapes.mesh import Mesh

WINDOW = (240, 240)
pytestmark = [pytest.mark.filterwarnings("ignore:the bulk holds"), pytest.mark.usefixtures("jagged_pictures")]


@pytest.fixture
def pair():
    """Return two disks on a floor in two dimensions, of which the upper one leans on the lower one."""
    up, lean = np.array([0.0, -1.0, 0.0]), np.array([-0.6, -0.8, 0.0])
    forces = ContactForces(
        i=[0, 1],
        j=[-1, 0],
        point=[[1, 0, 0], [1.3, 0.9, 0]],
        normal=[up, lean],
        force=[2 * up, lean],
        gap=[0, 0],
        residual=[0.0, 0.6],
        rattler=[False, False],
    )
    position = [[1, 0.5, 0], [1.6, 1.3, 0]]
    return vg.Packing.of(vg.shapes.disk(), vg.Rectangle((3, 3)), position=position, forces=forces)


def test_a_tube_is_a_closed_prism():
    start, end = np.array([[0.0, 0, 0], [1, 2, 3]]), np.array([[0.0, 0, 2], [2, 4, 5]])
    vertices, faces = tubes(start, end, np.array([0.5, 0.1]))
    each = len(faces) // 2
    for k, (length, radius) in enumerate([(2.0, 0.5), (3.0, 0.1)]):
        prism = Mesh(vertices[20 * k : 20 * k + 20], faces[each * k : each * k + each] - 20 * k)
        # a regular decagon has the area 10 / 2 r^2 sin(36 degrees)
        assert prism.volume == pytest.approx(5 * radius**2 * np.sin(np.pi / 5) * length)
    assert vertices[:10].mean(axis=0) == pytest.approx(start[0])
    assert vertices[30:].mean(axis=0) == pytest.approx(end[1])


def inked(picture):
    """Return where colours are those of tubes."""
    colors = picture.astype(int)
    return (np.ptp(colors, axis=2) > 40) | (colors.max(axis=2) < 60)


def test_chains_are_thicker_at_the_bottom_of_a_column():
    picture = picture_forces(column(4), window=WINDOW)
    rows = np.flatnonzero(inked(picture)[:220].any(axis=1))
    width = inked(picture).sum(axis=1)
    low, high = width[rows[len(rows) * 9 // 10]], width[rows[len(rows) // 10]]
    # at the floor four weights, between the two upper spheres one
    assert low / high == pytest.approx(4.0, rel=0.4)
    assert (picture != picture_forces(column(5), window=WINDOW)).any()


def test_chains_in_two_dimensions(pair):
    assert 0.005 < inked(picture_forces(pair, window=WINDOW)).mean() < 0.2


def test_no_forces_no_chains(pair):
    assert picture_forces(replace(pair, forces=None)) is None
    assert picture_forces(replace(pair, forces=replace(pair.forces, force=np.zeros((2, 3))))) is None


def test_grains_are_coloured_by_their_largest_force(pair):
    found = coloring(pair, "force")
    assert found.values.tolist() == [2.0, 1.0]
    assert found.label == "largest contact force"
    assert (picture_packing(pair, color_by="force", window=WINDOW) != picture_packing(pair, window=WINDOW)).any()
    assert vg.plot(pair, color_by="force", window=WINDOW).size == WINDOW
    for packing in (replace(pair, forces=None), pair[:0]):
        with pytest.raises(InputError, match="forces of the packing are None"):
            coloring(packing, "force")


def test_grains_are_coloured_by_their_residual(pair):
    found = coloring(pair, "residual")
    assert found.values.tolist() == [0.0, 0.6]
    assert found.title == "residual (weights of the grain)"
    assert colors_of(pair)[-2:] == ["force", "residual"]
    assert not {"force", "residual", "density"} & set(colors_of(replace(pair, forces=None)))


def test_rods_join_the_centroids_of_grains_that_touch():
    cell = vg.Packing.of([vg.shapes.sphere()], vg.Box((2, 5, 5), periodic="x"), position=[(0.5, 2, 2), (1.5, 2, 2)])
    with stage_of(WINDOW) as stage:
        add_contacts(stage, cell)
        (rods,) = (actor.mapper.dataset for actor in stage.actors.values())
    # one between the two, and one through the periodic side
    assert rods.split_bodies().n_blocks == 2
    assert np.ptp(np.reshape(rods.bounds, (3, 2))[0]) == pytest.approx(2.0)
    assert np.ptp(np.reshape(rods.bounds, (3, 2))[1:], axis=1) == pytest.approx(2 * ROD, rel=0.06)


@pytest.mark.slow
def test_a_page_shows_the_chains(pair, tmp_path):
    packing = column(6)
    save_report(packing, tmp_path / "p.html", statistics=vg.measure(packing), pictures_folder=tmp_path / "pictures")
    text = (tmp_path / "p.html").read_text()
    assert "Force chains: " in text
    assert (tmp_path / "pictures" / "forces.png").is_file()
    assert "100.0 %" in text
    found = json.loads((tmp_path / "p.json").read_text())
    assert sum(found["figures"]["contact_forces"]["density"]) * 0.25 == pytest.approx(1.0)
    assert found["statistics"]["share_at_rest"]["value"] == 1.0
    save_report(pair, tmp_path / "flat.html", pictures_folder=tmp_path / "flat")
    assert (tmp_path / "flat" / "forces.png").is_file()


def test_the_distribution_is_drawn_with_the_published_law():
    axes = Figure().add_subplot()
    x = np.linspace(0.01, 8, 2000)
    plot_forces(axes, x, np.exp(-x), decay=1.0)
    law, here = axes.get_lines()
    # the published constants are rounded: the integral and the mean are nearly 1
    assert law.get_ydata().sum() * (x[1] - x[0]) == pytest.approx(1.0, abs=0.02)
    assert (x * law.get_ydata()).sum() * (x[1] - x[0]) == pytest.approx(1.0, abs=0.05)
    assert here.get_label() == "decay of the tail 1.00"
    assert axes.get_yscale() == "log"
    bare = replace(column(3), forces=None)
    assert "contact_forces" not in [figure.name for figure in figures_of(bare, vg.measure(bare))]


def test_the_headline_says_whether_a_bed_rests():
    packing = column(6)
    packing = replace(
        packing, forces=replace(packing.forces, residual=[0, 0, 0, 0, 0, 1], rattler=[False] * 5 + [True])
    )
    found = {fact.label: fact for fact in facts.headline(packing, vg.measure(packing), None)}
    assert found["at rest"].value == "83.3 %"
    assert found["at rest"].tone == "bad"
    assert "16.7 % of the grains are rattlers" in found["without rattlers"].note
    alone = {fact.label: fact for fact in facts.headline(packing, None, None)}
    assert "16.7 % are rattlers" in alone["at rest"].note
    assert found["coordination number"].value == "1.67"
    assert "segregation" not in found
    rests = {fact.label: fact for fact in facts.headline(column(6), None, None)}
    assert rests["at rest"].tone == "good"


@pytest.mark.parametrize("order", [1, -1])
def test_the_headline_warns_of_segregation(order):
    position = np.column_stack([np.full((60, 2), 1.0), np.arange(60) + 0.5])
    sizes = np.linspace(0.5, 0.9, 60)
    box = vg.Box((2, 2, 60))
    bed = vg.Packing.of(vg.shapes.sphere(radius=0.5), box, position=position, scale=sizes[::order])
    found = {fact.label: fact for fact in facts.headline(bed, vg.measure(bed), None)}
    assert found["segregation"].value == ("1.00" if order == 1 else "\u22121.00")
    assert found["segregation"].tone == "bad"
    assert found["segregation"].note.startswith(f"large grains lie {'above' if order == 1 else 'below'} small ones")
    shuffled = replace(bed, scale=stream(1, "order").permutation(sizes))
    calm = {fact.label: fact for fact in facts.headline(shuffled, vg.measure(shuffled), None)}
    assert calm["segregation"].tone == ""
