"""One family of shapes per file, in folders by kind; the file name is the name of the family."""

from voxgran._base import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
