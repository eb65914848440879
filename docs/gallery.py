"""The gallery of the site: sphinx-gallery runs the scripts of examples/ and shows the pictures that they write.

A script takes the folder of its files as its first argument. The gallery gives each script a folder of its own, and
collects from it the pictures that are new after each cell. The description of a picture for those who do not see it is
a comment above the call that saves it: ``# Picture: ...``, one for each picture, in the order in which they are saved.
"""

import os
import re
import shutil
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: where scripts of the gallery write; it is emptied before a script runs
OUTPUT = ROOT / "out" / "gallery"
SUFFIXES = (".png", ".svg")

#: a notebook has no arguments and no file of its own; pictures are shown at its end
FIRST_CELL = """import sys

sys.argv = sys.argv[:1]  # no arguments: the script takes its defaults"""
LAST_CELL = """from IPython.display import SVG, Image, display

for path in sorted(folder.iterdir()):
    if path.suffix in (".png", ".svg"):
        display(Image(path) if path.suffix == ".png" else SVG(path))"""


def folder_of(script: str | os.PathLike[str]) -> Path:
    """Return the folder into which the gallery lets a script write."""
    return OUTPUT / Path(script).stem


def arguments_of(gallery_conf: dict[str, Any], script_vars: dict[str, Any]) -> list[str]:
    """Return the arguments of a script: its folder, which is emptied."""
    del gallery_conf
    folder = folder_of(script_vars["src_file"])
    shutil.rmtree(folder, ignore_errors=True)
    return [str(folder)]


def descriptions_in(code: str) -> list[str]:
    """Return the descriptions of the pictures that a piece of a script saves."""
    found = re.findall(r"^ *# Picture: (.*(?:\n *#   .*)*)", code, flags=re.MULTILINE)
    return [re.sub(r"\s*\n *# +", " ", text).strip() for text in found]


def pictures_in(folder: Path) -> list[Path]:
    """Return the pictures of a folder in the order in which they were written."""
    found = [path for path in folder.glob("*") if path.suffix in SUFFIXES]
    return sorted(found, key=lambda path: (path.stat().st_mtime_ns, path.name))


def collect_pictures(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Copy the pictures that a cell has written into the gallery, and return the reStructuredText that shows them."""
    from sphinx_gallery.scrapers import figure_rst

    folder = folder_of(block_vars["src_file"])
    taken = block_vars["example_globals"].setdefault("__pictures_of_the_gallery__", set())
    new = [path for path in pictures_in(folder) if path.name not in taken]
    texts = descriptions_in(block[1])
    if len(texts) != len(new):
        raise ValueError(
            f"a cell of {Path(block_vars['src_file']).name} wrote {len(new)} pictures and describes {len(texts)}: each "
            f"picture needs one comment '# Picture: ...' above the call that saves it"
        )
    shown = []
    for path, text in zip(new, texts, strict=True):
        taken.add(path.name)
        target = Path(next(block_vars["image_path_iterator"])).with_suffix(path.suffix)
        shutil.copyfile(path, target)
        shown.append(figure_rst([str(target)], gallery_conf["src_dir"], text))
    return "".join(shown)


SPHINX_GALLERY_CONF: dict[str, Any] = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"(__init__\.py|[\\/]plugin[\\/])",
    "within_subsection_order": "FileNameSortKey",
    "nested_sections": False,
    # names, since Sphinx keeps its configuration in a file
    "reset_argv": "gallery.arguments_of",
    "image_scrapers": ("matplotlib", "gallery.collect_pictures"),
    "reset_modules": ("matplotlib",),
    "capture_repr": (),
    "first_notebook_cell": FIRST_CELL,
    "last_notebook_cell": LAST_CELL,
    "thumbnail_size": (400, 280),
    "download_all_examples": False,
    "abort_on_example_error": True,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 0,
    "write_computation_times": False,
    "plot_gallery": True,
    "inspect_global_variables": False,
}
