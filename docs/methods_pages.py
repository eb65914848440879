"""Pages of the site for packing methods, clump methods and shape families: one each, made from the registries.

:func:`write_pages` writes Markdown and pictures into a folder beside docs/guide and docs/figures. What a page says
comes from the registration of the entry, which `voxgran methods NAME` prints too, from the tables of
docs/guide, and from the example of the entry in method_cases.py.
"""

import re
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
from method_cases import CLUMPS, FAMILIES, PACKING, Case

import voxgran as vg
from voxgran._base.config import parameters_of
from voxgran._base.registry import Registry
from voxgran.clumps.method import clump_registry
from voxgran.packing.method import method_registry
from voxgran.report.gallery import picture_clumps, picture_shapes
from voxgran.report.scenes import picture_packing
from voxgran.shapes.family import families

DOCS = Path(__file__).resolve().parent
#: width and height of the picture of a packing, in pixels
WINDOW = (400, 400)


@dataclass(frozen=True)
class Kind:
    """One kind of pages: a folder with an index."""

    folder: str
    title: str
    intro: str
    registry: Callable[[], Registry[Any]]
    cases: dict[str, Case]
    draw: Callable[[str, Case], np.ndarray]
    examples: Callable[[str, Case], Iterator[str]]


def write_pages(folder: Path, *, pictures: bool = True) -> list[Path]:
    """Write the pages of all methods and families, and an index of each kind; return the pages.

    Where nothing can be drawn, as on a machine without EGL, the pages have no pictures, which a warning says.
    """
    folder = Path(folder)
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    pages = []
    for kind in KINDS:
        (folder / kind.folder).mkdir(exist_ok=True)
        for name in kind.registry().names():
            case = kind.cases.get(name, Case(""))
            if pictures:
                pictures = _draw(kind, name, case, folder / "pictures" / f"{kind.folder}_{name}.png")
            pages.append(_write(folder / kind.folder / f"{name}.md", page_of(kind, name, folder)))
        pages.append(_write(folder / kind.folder / "index.md", index_of(kind, folder)))
    pages.append(_write(folder / "index.md", _index()))
    return pages


def page_of(kind: Kind, name: str, folder: Path) -> str:
    """Return the page of one entry."""
    entry, case = kind.registry().get(name), kind.cases.get(name, Case(""))
    when, cost = _told(kind, name, case)
    lines = [f"# {name}", "", f"{_sentence(entry.summary)}", ""]
    lines += _picture(kind, name, folder)
    lines += ["## When to take it", "", when, ""] if when else []
    lines += ["## Example", "", *kind.examples(name, case)]
    lines += ["## Parameters", "", *_parameters(entry), f"At the prompt `voxgran methods {name}` prints them.", ""]
    lines += ["## Cost and error", "", cost, ""]
    if case.bench:
        lines += [f"![Figure of the bench {case.bench}: error or density against time](../../figures/{case.bench}.svg)"]
        lines += ["", f"The figure is drawn by `python -m benchmarks {case.bench} -o docs/figures`.", ""]
    lines += ["## Source", "", f"{_linked(entry.source)}" if entry.source else "Geometry in closed form.", ""]
    lines += [f"More in the guide: [{case.guide}](../../guide/{case.guide})."] if case.guide else []
    return "\n".join(lines) + "\n"


def index_of(kind: Kind, folder: Path) -> str:
    """Return the page that lists all entries of a kind, with small pictures."""
    lines = [f"# {kind.title}", "", kind.intro, "", "| | name | what it is |", "|---|---|---|"]
    for name in kind.registry().names():
        there = (folder / "pictures" / f"{kind.folder}_{name}.png").is_file()
        image = f"![{name}](../pictures/{kind.folder}_{name}.png){{height=70px}}" if there else ""
        lines.append(f"| {image} | [{name}]({name}.md) | {kind.registry().get(name).summary} |")
    return "\n".join([*lines, "", *_toctree(kind.registry().names())]) + "\n"


def _index() -> str:
    """Return the page above the three indexes."""
    lines = ["# Methods", "", "Each packing method, clump method and shape family has a page.", ""]
    lines += ["| kind | number |", "|---|---|"]
    lines += [f"| [{kind.title}]({kind.folder}/index.md) | {len(kind.registry().names())} |" for kind in KINDS]
    return "\n".join([*lines, "", *_toctree([f"{kind.folder}/index" for kind in KINDS])]) + "\n"


def _toctree(names: Any) -> list[str]:
    """Return a hidden table of contents."""
    return ["```{toctree}", ":hidden:", "", *names, "```"]


def _write(path: Path, text: str) -> Path:
    """Write a page unless it is there already, so that Sphinx reads only what has changed."""
    if not path.is_file() or path.read_text() != text:
        path.write_text(text)
    return path


def _picture(kind: Kind, name: str, folder: Path) -> list[str]:
    """Return the picture of an entry, if it could be drawn."""
    path = Path("pictures") / f"{kind.folder}_{name}.png"
    if not (folder / path).is_file():
        return []
    return [f"![Result of the example of {name} below](../{path.as_posix()})", ""]


def _draw(kind: Kind, name: str, case: Case, path: Path) -> bool:
    """Draw the example of an entry into a file, unless it is there; return whether this machine can draw."""
    if path.is_file():
        return True
    try:
        picture = kind.draw(name, case)
    except (RuntimeError, OSError, ImportError) as error:
        warnings.warn(f"pages of methods have no pictures: {error}", stacklevel=2)
        return False
    matplotlib.image.imsave(path, picture)
    return True


def _parameters(entry: Any) -> list[str]:
    """Return the table of the parameters of an entry."""
    items = parameters_of(entry.parameters)
    if not items:
        return ["It has no parameters.", ""]
    rows = ["| name | type | default | unit | meaning |", "|---|---|---|---|---|"]
    for item in items:
        default = "must be given" if item.default is MISSING else "" if item.default is None else f"`{item.default!r}`"
        cells = [f"`{item.name}`", item.type_text, default, item.unit, item.doc]
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return [*rows, ""]


def table_row(page: Path, name: str) -> dict[str, str]:
    """Return the row of a table of a page whose first cell names the entry, by the heads of the columns."""
    head: list[str] = []
    for line in page.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        head = cells if cells and not head else head if cells else []
        if cells and re.search(rf"`{name}`", cells[0]) and len(cells) == len(head) and head[0] in _HEADS:
            return dict(zip(head, cells, strict=True))
    return {}


#: heads of the first columns of the tables that describe methods and families
_HEADS = ("method", "family", "method or program")


def _told(kind: Kind, name: str, case: Case) -> tuple[str, str]:
    """Return when to take an entry, and what it costs, from the tables of the guide."""
    if kind.folder == "packing":
        row = table_row(DOCS / "guide/choosing.md", name)
        return _sentence(row.get("use", case.when)), _sentence(row.get("cost and accuracy", "Not measured yet"))
    if kind.folder == "clumps":
        rows = [
            line for line in (DOCS / "guide/clumps.md").read_text().splitlines() if line.startswith(f"| `{name}` |")
        ]
        shares = [cell.strip() for cell in rows[-1].strip("| ").split("|")] if rows else []
        told = f"Intersection over union with 50 spheres (CPU seconds): {shares[1]} for a cube, {shares[2]} for "
        return case.when, f"{told}Eros, {shares[3]} for Itokawa and {shares[4]} for Bennu." if shares else ""
    row = table_row(DOCS / "guide/shapes.md", name)
    law = f"Tests hold it to a law: {row['law that its tests hold it to']}. " if row else ""
    options = _made(case)
    vg.make_shape(name, **options)
    began = time.process_time()
    shape = vg.make_shape(name, **options)
    seconds = time.process_time() - began
    size = f"{len(shape.faces):,} triangles" if shape.dimension == 3 else f"{len(shape.vertices):,} corners"
    return case.when, f"{law}The example has {size} and took {_rounded(1e3 * seconds)} ms when this page was made."


def _made(case: Case) -> dict[str, Any]:
    """Return the options of an example, with a model in place of the file in which a reader has one."""
    if "model" not in case.options:
        return dict(case.options)
    return {**case.options, "model": vg.learn_shapes(vg.make_shapes("solid_union", count=12))}


def _rounded(value: float) -> str:
    """Return one digit of a number, since times differ between machines and runs."""
    return f"{float(f'{value:.0e}'):g}"


def _sentence(text: str) -> str:
    """Return text that begins with a capital letter and ends with a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def _linked(text: str) -> str:
    """Return text in which each DOI is a link."""
    return re.sub(r"doi:(10\.[^\s;,]+)", r"[doi:\1](https://doi.org/\1)", text)


def python_of(value: dict[str, Any], *, name: str, head: str) -> str:
    """Return a call with the entry of that name first, such as ``vg.make_shape("sphere")``."""
    rest = {key: entry for key, entry in value.items() if key != name}
    words = [repr(value[name]).replace("'", '"'), *(f"{key}={_literal(entry)}" for key, entry in rest.items())]
    return f"{head}({', '.join(words)})"


def _literal(value: Any) -> str:
    """Return Python for a value, with double quotes as in the examples of the guide."""
    return repr(value).replace("'", '"')


def packing_call(name: str, case: Case) -> str:
    """Return the Python of the example of a packing method."""
    spread = [f"{key}={value}" for key, value in case.sizes.items() if key != "kind"]
    sizes = f"vg.sizes.{case.sizes['kind']}({', '.join(spread)})" if spread else ""
    options = [f"{key}={_literal(value)}" for key, value in case.options.items()]
    options += [f"sizes={sizes}"] if sizes else []
    options += ["seed=1"]
    kind, size, *rest = case.container.items()
    axes = ", ".join(["", *(f'{key}="{"".join(value)}"' for key, value in rest)])
    container = f"vg.{kind[1].title()}({tuple(size[1]) if isinstance(size[1], list) else size[1]}{axes})"
    lines = ["import voxgran as vg", "", f"shape = {python_of(case.shape, name='family', head='vg.make_shape')}"]
    lines += [f"container = {container}"]
    lines += [f'packing = vg.pack(shape, container, method="{name}", {", ".join(options)})']
    return "\n".join(lines)


def packing_scene(name: str, case: Case) -> str:
    """Return the example of a packing method as a scene."""
    tables = {"scene": {"seed": 1}, "[shape]": case.shape, "sizes": case.sizes, "container": case.container}
    tables["packing"] = {"method": name, **case.options}
    return "\n\n".join(_toml(title, table) for title, table in tables.items() if table)


def _toml(title: str, table: dict[str, Any]) -> str:
    """Return one table of a scene."""
    texts = {key: str(value).lower() if isinstance(value, bool) else _literal(value) for key, value in table.items()}
    return "\n".join([f"[{title}]", *(f"{key} = {text}" for key, text in texts.items())])


def _packing_examples(name: str, case: Case) -> Iterator[str]:
    """Yield the example of a packing method in Python and as a scene."""
    yield from ("```python", packing_call(name, case), "print(vg.verify(packing))", "```", "")
    yield from ("The same as a scene, which `voxgran run` packs:", "", "```toml", packing_scene(name, case), "```", "")


def _draw_packing(name: str, case: Case) -> np.ndarray:
    """Run the example of a packing method and draw the packing."""
    found: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(packing_call(name, case), found)
    return picture_packing(found["packing"], window=WINDOW)


def _clump_examples(name: str, case: Case) -> Iterator[str]:
    """Yield the example of a clump method in Python and at the prompt."""
    del case
    yield from ("```python", "import voxgran as vg", "", 'rock = vg.load_shape(vg.data_file("eros.obj"))')
    yield from (f'clump = vg.fit_clump(rock, method="{name}", max_spheres=50)', "print(clump.errors)", "```", "")
    yield from (
        "At the prompt:",
        "",
        "```console",
        f"$ voxgran clump eros.obj --method {name} --spheres 50 -o eros.csv",
    )
    yield from ("```", "")


def _draw_clump(name: str, case: Case) -> np.ndarray:
    """Draw the scan beside its clump."""
    del case
    rock = vg.load_shape(vg.data_file("eros.obj"))
    return picture_clumps([vg.fit_clump(rock, method=name, max_spheres=50)], window=(300, 220))


def shape_call(name: str, case: Case) -> str:
    """Return the Python of the example of a family."""
    return python_of({"family": name, **case.options}, name="family", head="vg.make_shape")


def _shape_examples(name: str, case: Case) -> Iterator[str]:
    """Yield the example of a family in Python, in a scene and at the prompt."""
    yield from ("```python", "import voxgran as vg", "", f"shape = {shape_call(name, case)}", "```", "")
    table = {key: list(value) if isinstance(value, tuple) else value for key, value in case.options.items()}
    yield from ("In a scene:", "", "```toml", _toml("[shape]", {"family": name, **table}), "```", "")


def _draw_shape(name: str, case: Case) -> np.ndarray:
    """Draw four shapes of a family, or one where all are alike."""
    seeds = range(1, 5) if families().get(name).random else (0,)
    options = _made(case)
    picture = picture_shapes([vg.make_shape(name, seed=seed, **options) for seed in seeds], columns=len(seeds))
    step = max(1, picture.shape[0] // 180)
    # each pixel is the mean of a square of the picture
    height, width = (length // step * step for length in picture.shape[:2])
    small = picture[:height, :width].reshape(height // step, step, width // step, step, 3).mean(axis=(1, 3))
    return small.round().astype(np.uint8)


KINDS = (
    Kind(
        "packing",
        "Packing methods",
        "How grains get into the container. [The guide to sphere packings](../../guide/spheres.md) compares them.",
        method_registry,
        PACKING,
        _draw_packing,
        _packing_examples,
    ),
    Kind(
        "clumps",
        "Clump methods",
        "How spheres stand for a solid. [The guide to clumps](../../guide/clumps.md) compares their errors.",
        clump_registry,
        CLUMPS,
        _draw_clump,
        _clump_examples,
    ),
    Kind(
        "shapes",
        "Shape families",
        "Solids, outlines and open surfaces. [The guide to shapes](../../guide/shapes.md) describes their laws.",
        families,
        FAMILIES,
        _draw_shape,
        _shape_examples,
    ),
)
