"""What every engine must keep, as a class of tests to derive from."""

from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from voxgran._base.errors import InputError, OutputExistsError
from voxgran.containers.kinds.box import Box
from voxgran.decks.engine import Engine, engine_registry
from voxgran.decks.write import write_deck
from voxgran.packing.model import Packing
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: what a stranger may write into the name of a shape, and the marks that begin a comment in the files of engines
NAME, MARKS = "rock\nimport os; os.abort()\n", ("#", "//", ";", "--", "%", "!")


class EngineSuite:
    """Tests of one engine; derive from it in a test file and name the engine.

    Attributes
    ----------
    engine : str
        Name under which the engine is registered.

    Examples
    --------
    >>> from voxgran.testing import EngineSuite
    >>> class TestLammps(EngineSuite):
    ...     engine = "lammps"
    """

    engine: ClassVar[str] = ""

    @classmethod
    def entry(cls) -> Engine:
        """Return the registration of the engine."""
        return engine_registry().get(cls.engine)

    @classmethod
    def shape(cls) -> Shape:
        """Return the shape of the grains: a sphere where the engine has these, a convex polyhedron elsewhere."""
        return make_shape("sphere") if "sphere" in cls.entry().kinds else make_shape("convex_polyhedron", seed=1)

    @classmethod
    def packing(cls, *, height: float = 1.0) -> Packing:
        """Return three grains in a box, the last one at some height."""
        places = [(1.0, 1.0, 1.0), (3.0, 1.0, 1.0), (1.0, 3.0, height)]
        return Packing.of([cls.shape()], Box((4, 4, 4)), position=places, unit="mm", density=2500.0)

    def test_the_registration_is_complete(self) -> None:
        """Name, what is written, its documentation, what it was tried with, and kinds of grains."""
        entry = self.entry()
        assert entry.name == self.engine
        assert entry.title
        assert entry.summary
        assert entry.source
        assert entry.verified
        assert entry.kinds

    def test_files_begin_with_the_name_of_the_engine_and_state_units(self, tmp_path: Path) -> None:
        """Decks of several engines share a folder, and each tells what wrote it and in which units."""
        deck = write_deck(self.packing(), tmp_path, self.engine)
        assert deck.files
        assert all(path.name.startswith(self.engine) and path.is_file() for path in deck.files)
        together = "".join(path.read_text() for path in deck.files)
        assert "voxgran" in together
        assert "kg" in together

    def test_what_is_read_is_what_was_written(self, tmp_path: Path) -> None:
        """True mass and centroid of each grain, in SI units; skipped where the engine has no reader."""
        reader = self.entry().read
        if reader is None:
            pytest.skip("the engine has no reader")
        deck = write_deck(self.packing(), tmp_path, self.engine)
        held, bodies = reader(tmp_path), deck.simulation.bodies
        np.testing.assert_allclose(held.mass, bodies.mass, rtol=1e-6)
        np.testing.assert_allclose(held.position, 1e-3 * self.packing().position, rtol=0, atol=1e-9)

    def test_each_grain_has_the_density_of_its_shape(self, tmp_path: Path) -> None:
        """Masses of grains of two materials, in kg; skipped where the engine has no reader."""
        reader = self.entry().read
        if reader is None:
            pytest.skip("the engine has no reader")
        one = self.packing()
        two = Packing.of(
            [self.shape()] * 2,
            one.container,
            position=one.position,
            shape_id=[0, 1, 0],
            unit="mm",
            density=[7800, 2500],
        )
        write_deck(two, tmp_path, self.engine)
        np.testing.assert_allclose(reader(tmp_path).mass, 1e-9 * self.shape().volume * two.densities, rtol=1e-6)

    def test_nothing_is_overwritten_unasked(self, tmp_path: Path) -> None:
        """A deck stays as it is unless it is to be replaced."""
        deck = write_deck(self.packing(), tmp_path, self.engine)
        before = {path: path.read_text() for path in deck.files}
        with pytest.raises(OutputExistsError, match="overwrite=True"):
            write_deck(self.packing(height=2.0), tmp_path, self.engine)
        assert {path: path.read_text() for path in deck.files} == before
        again = write_deck(self.packing(height=2.0), tmp_path, self.engine, overwrite=True)
        assert {path: path.read_text() for path in again.files} != before

    def test_bad_input_writes_nothing(self, tmp_path: Path) -> None:
        """A coefficient of restitution of 2 is refused before a folder is made."""
        with pytest.raises(InputError):
            write_deck(self.packing(), tmp_path / "new", self.engine, material={"restitution": 2.0})
        assert not (tmp_path / "new").exists()

    def test_names_of_shapes_become_no_commands(self, tmp_path: Path) -> None:
        """A name of several lines, from a file of a stranger, stays in comments of one line."""
        clump = None if "clump" not in self.entry().kinds else 4
        shape = Shape.of(make_shape("convex_polyhedron", seed=1).geometry, name=NAME)
        packing = Packing.of([shape], Box((4, 4, 4)), position=[[2, 2, 2]])
        for path in write_deck(packing, tmp_path, self.engine, clump=clump).files:
            lines = [line for line in path.read_text().splitlines() if "os.abort" in line]
            assert [line for line in lines if not line.lstrip().startswith(MARKS)] == []
