"""What tests of decks share."""

import pytest

from voxgran.clumps.fit import fit_clump


@pytest.fixture(scope="session")
def fitted():
    """Return the clumps that were fitted, by name, vertices and number of spheres."""
    return {}


@pytest.fixture(autouse=True)
def fitted_once(fitted, monkeypatch):
    """Fit a clump to each shape once, which takes longer than all else where rocks are written for an engine."""

    def fit(shape, *, max_spheres):
        key = (shape.name, shape.vertices.tobytes(), max_spheres)
        if key not in fitted:
            fitted[key] = fit_clump(shape, max_spheres=max_spheres)
        return fitted[key]

    monkeypatch.setattr("voxgran.decks.write.fit_clump", fit)
