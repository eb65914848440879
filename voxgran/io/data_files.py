"""The scans that come with the package, for examples and the demo."""

from pathlib import Path

from voxgran._base.arrays import check_type
from voxgran._base.calls import explained
from voxgran._base.errors import MissingFileError, check_known

#: what the installed package holds, or the checkout beside it; data/SOURCES.md names the origin of each
DATA_FILES = {
    "bennu_lp.obj": "asteroid Bennu, 1,474 triangles; NASA, free of restrictions",
    "bunny_dirty.ply": "Stanford bunny with holes, 16,301 triangles; MIT licence",
    "eros.obj": "asteroid Eros, 14,744 triangles; NASA, free of restrictions",
    "ice_cream_cone.npy": "voxel image of a grain, 64 x 64 x 64; MIT licence",
    "itokawa_lp.obj": "asteroid Itokawa, 1,622 triangles; JAXA, free of restrictions",
}


@explained(hint='data_file("eros.obj")')
def data_file(name: str) -> Path:
    """Return the path of a file that comes with voxgran, such as the scan of an asteroid.

    Parameters
    ----------
    name : {"bennu_lp.obj", "bunny_dirty.ply", "eros.obj", "ice_cream_cone.npy", "itokawa_lp.obj"}
        Surfaces of the asteroids Bennu, Eros and Itokawa; the Stanford bunny with holes and stray triangles; a voxel
        image.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    UnknownNameError
        If no file of that name comes with voxgran; the message gives the nearest one.
    MissingFileError
        If the file is not installed.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.load_shape(vg.data_file("itokawa_lp.obj")).name
    'itokawa_lp'
    """
    check_type(name, str, "name", "the name of a file that comes with voxgran, such as 'eros.obj'")
    check_known("file of voxgran", name, DATA_FILES)
    place = _place_of(name)
    if place is None:
        raise MissingFileError(
            f"{name} is not in the installed package: it comes with a checkout of voxgran; here are "
            f"{', '.join(installed_data_files())}"
        )
    return place


def installed_data_files() -> dict[str, str]:
    """Return the files that are there, with what they are."""
    return {name: about for name, about in DATA_FILES.items() if _place_of(name) is not None}


def _place_of(name: str) -> Path | None:
    """Return where a file is, in the package or in the checkout beside it; None where it is in neither."""
    package = Path(__file__).parents[1]
    places = (folder / name for folder in (package / "data", package.parent / "data"))
    return next((place for place in places if place.is_file()), None)
