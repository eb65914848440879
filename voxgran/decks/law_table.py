"""Contact laws of a simulation by the materials of grains and walls."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement

from voxgran.decks.contact_law import ContactLaw
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials


@dataclass(frozen=True, eq=False)
class LawTable:
    """Contact laws between materials; one material has one.

    Attributes
    ----------
    names : tuple of str
        Names of the materials.
    laws : tuple of tuple of ContactLaw
        Law of contacts between two materials, by their numbers.
    of_shapes : tuple of int
        Number of the material of each template.
    of_walls : mapping
        Number of the material of each wall by its name, as :class:`voxgran.Materials` has them.
    """

    names: tuple[str, ...]
    laws: tuple[tuple[ContactLaw, ...], ...]
    of_shapes: tuple[int, ...]
    of_walls: Mapping[str, int]

    @property
    def count(self) -> int:
        """Number of materials."""
        return len(self.names)

    @property
    def rolls(self) -> bool:
        """Whether there is rolling friction between any two materials."""
        return any(law.rolling_friction > 0.0 for row in self.laws for law in row)

    def pairs(self) -> Iterator[tuple[int, int, ContactLaw]]:
        """Yield all pairs of materials with their laws, each once, the smaller number first."""
        return ((a, b, self.laws[a][b]) for a in range(self.count) for b in range(a, self.count))

    def matrix(self, name: str) -> list[list[float]]:
        """Return a number of the laws between all materials."""
        return [[float(getattr(law, name)) for law in row] for row in self.laws]

    @property
    def slowest(self) -> ContactLaw:
        """The law with the shortest stable time step; the only one of a single material."""
        return min((law for _, _, law in self.pairs()), key=lambda law: law.stable_step)


def law_table(
    material: Material | Materials, law_of: Callable[[Material], ContactLaw], shapes: int, walls: tuple[str, ...]
) -> LawTable:
    """Return the contact laws of a simulation; `law_of` makes the law of a material.

    Raises
    ------
    InputError
        If a shape or a wall has no material.
    """
    if isinstance(material, Material):
        return LawTable(("grains",), ((law_of(material),),), (0,) * shapes, dict.fromkeys(walls, 0))
    names = material.names
    number = {name: k for k, name in enumerate(names)}
    made = {pair: law_of(material.between(*pair)) for pair in combinations_with_replacement(sorted(names), 2)}
    laws = tuple(tuple(made[min(a, b), max(a, b)] for b in names) for a in names)
    of_shapes = tuple(number[name] for name in material.of_shapes(shapes))
    return LawTable(names, laws, of_shapes, {wall: number[material.of_wall(wall)] for wall in walls})
