"""What every engine must keep, as a class of tests to derive from."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from voxgran._base.errors import InputError, OutputExistsError
from voxgran.clumps.fit import fit_clump
from voxgran.clumps.model import Clump
from voxgran.containers.kinds.box import Box
from voxgran.decks.engine import Engine, engine_registry
from voxgran.decks.write import write_deck
from voxgran.packing.model import Packing
from voxgran.settling.materials import Materials
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: a coefficient that stands for nothing else in a file
NUMBER = 0.1375
#: what a stranger may write into the name of a shape, and the marks that begin a comment in the files of engines
NAME, MARKS = "rock\nimport os; os.abort()\n", ("#", "//", ";", "--", "%", "!")


@cache
def _hostile_clump() -> Clump:
    """Return a clump of a shape with such a name, fitted once."""
    return fit_clump(Shape.of(make_shape("convex_polyhedron", seed=1).geometry, name=NAME), max_spheres=4)


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

    def written(self, folder: Path, packing: Packing, **asked: Any) -> str:
        """Return the text of all files of a deck."""
        return "\n".join(path.read_text() for path in write_deck(packing, folder, self.engine, **asked).files)

    def test_fixed_grains_are_written_or_refused(self, tmp_path: Path) -> None:
        """A grain that is fixed is another deck, with its true mass; an engine without fixed grains says so."""
        entry, still = self.entry(), replace(self.packing(), fixed=np.array([True, False, False]))
        if not entry.fixed:
            with pytest.raises(InputError, match="1 grains are fixed"):
                write_deck(still, tmp_path, self.engine)
            return
        told = self.written(tmp_path / "fixed", still)
        assert "1 grains are fixed" in told
        free = self.written(tmp_path / "free", self.packing())
        assert told.replace("1 grains are fixed", "").split() != free.split()
        if entry.read is not None:
            np.testing.assert_allclose(entry.read(tmp_path / "fixed").mass, entry.read(tmp_path / "free").mass)

    def test_friction_of_pairs_is_written_or_refused(self, tmp_path: Path) -> None:
        """The coefficient of two materials, or its angle, stands in the files; an engine of one material says so."""
        materials = Materials(
            {"sand": {"friction": 0.6}, "steel": {"friction": 0.3}},
            {("sand", "steel"): {"friction": NUMBER}},
            shapes="sand",
            walls="steel",
        )
        if not self.entry().materials:
            with pytest.raises(InputError, match=r"material has 2 materials: .* has one"):
                write_deck(self.packing(), tmp_path, self.engine, material=materials)
            return
        told = self.written(tmp_path, self.packing(), material=materials)
        assert repr(NUMBER) in told or repr(math.atan(NUMBER)) in told

    def test_rolling_friction_is_written_or_refused(self, tmp_path: Path) -> None:
        """The coefficient, or half of it for another radius, stands in the files of each law; others are refused."""
        entry, packing = self.entry(), self.packing()
        for law in entry.laws:
            material = {"law": law, "rolling_friction": NUMBER} | ({"young_modulus": 1e7} if law == "hertz" else {})
            if law in entry.rolling:
                told = self.written(tmp_path / law, packing, material=material)
                assert repr(NUMBER) in told or repr(NUMBER / 2) in told
            else:
                with pytest.raises(InputError, match=f"rolling_friction is {NUMBER:g}.*leave it out"):
                    write_deck(packing, tmp_path / law, self.engine, material=material)

    def test_a_stress_of_walls_is_written_or_refused(self, tmp_path: Path) -> None:
        """The force on the upper wall of the one axis along which there is a stress stands in the files."""
        packing, stress = replace(self.packing(), gravity=None), (math.nan, math.nan, 1e3)
        if not self.entry().platens:
            with pytest.raises(InputError, match="has no walls that keep one"):
                write_deck(packing, tmp_path, self.engine, stress=stress)
            return
        told = self.written(tmp_path, packing, stress=stress)
        force = write_deck(packing, tmp_path / "again", self.engine, stress=stress).simulation.platens[0].force
        # in the header and in a command
        assert told.count(repr(force)) > told.count("moves so that grains press")

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
        hostile = _hostile_clump()
        clump = hostile if "clump" in self.entry().kinds else None
        packing = Packing.of([hostile.shape], Box((4, 4, 4)), position=[[2, 2, 2]])
        for path in write_deck(packing, tmp_path, self.engine, clump=clump).files:
            lines = [line for line in path.read_text().splitlines() if "os.abort" in line]
            assert [line for line in lines if not line.lstrip().startswith(MARKS)] == []
