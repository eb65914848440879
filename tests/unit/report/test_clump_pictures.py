"""Pictures of clumps: the bodies, their names below them, and the scale of their colours."""

import numpy as np
from matplotlib import colormaps

import voxgran as vg
from voxgran.report.gallery import COLORS, picture_clumps


def test_names_and_a_colour_bar_stand_below_the_bodies():
    rock = vg.make_shape("convex_polyhedron", seed=1)
    picture = picture_clumps([vg.fit_clump(rock, max_spheres=count) for count in (1, 4)]).astype(int)
    assert picture.shape[1] == 3 * 420
    assert 380 < picture.shape[0] < 480
    inked = np.abs(picture - picture[0, 0]).max(axis=2) > 12
    for body in range(3):
        rows = np.flatnonzero(inked[:380, 420 * body : 420 * body + 420].any(axis=1))
        # the body, a gap, its name
        (gap,) = np.flatnonzero(np.diff(rows) > 3)
        assert 0.6 * 380 < rows[gap] < 380 - 28
        assert 5 < len(rows) - gap - 1 < 20
    # the ends of the bar: inside of the solid and outside
    bar = picture[380:]
    for end in (0.0, 1.0):
        color = 255 * np.array(colormaps[COLORS](end)[:3])
        assert (np.abs(bar - color).max(axis=2) < 4).sum() > 20
