"""What the commands do that have no module of their own, by the names in :mod:`voxgran.cli.commands`.

The command `data` lists the files that come with the package, or copies one.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import MISSING
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import voxgran
from voxgran._base.config import parameters_of
from voxgran._base.errors import InputError, UnknownNameError, shown, unknown
from voxgran._base.files import write_text, written_whole
from voxgran.cli.parameters import parameter_text
from voxgran.cli.terminal import UNITS, complain, entry_line, loaded, progress, say_assumed, show, table
from voxgran.io.data_files import installed_data_files
from voxgran.shapes.files import check_surface_output

#: which parts use several cores
CORES = (
    "packing uses one core; voxelization, distance transforms, local thickness, contacts, also those of grains that "
    "settle, verify and measures use all, or as many as OMP_NUM_THREADS says, with the same bits; voxgran study runs "
    "one cell on each"
)


def init(options: argparse.Namespace) -> None:
    """Write a scene file to start from."""
    scene = Path(__file__).with_name("scene.toml").read_text(encoding="utf-8")
    write_text(options.file, scene, overwrite=options.overwrite)
    print(f"{options.file}: edit it, then 'voxgran plan {options.file}' and 'voxgran run {options.file} -o out'")


def plan(options: argparse.Namespace) -> None:
    """Say what a run would compute, skip and cost."""
    made = voxgran.Scene.from_toml(options.file).plan()
    print(json.dumps(made.to_mapping(), indent=2) if options.json else made)


def run(options: argparse.Namespace) -> None:
    """Pack, check, measure and save a scene."""
    scene = voxgran.Scene.from_toml(options.file)
    with progress(options) as on_step:
        result = scene.run(options.output, resume=options.resume, overwrite=options.overwrite, on_step=on_step)
    summary = dict(result.summary)
    if not options.json and "runs" in summary:
        spread = summary["standard_error"]
        table([{"": name, "mean": value, "standard error": spread[name]} for name, value in summary["mean"].items()])
        summary = {key: summary[key] for key in ("method", "seeds", "verify")}
    elif not options.json:
        summary.pop("plan", None)
    show(summary, options, f"results in {result.folder}")


def verify(options: argparse.Namespace) -> int:
    """Check a packing against the true shapes; exit status 1 where it fails."""
    packing = loaded(options)
    with progress(options) as on_step:
        proof = voxgran.verify(packing, tolerance=options.tolerance, on_step=on_step)
    show(_fields(proof, "ok", "overlapping_pairs", "deepest", "escaped", "touching_at", "tolerance"), options)
    return 0 if proof.ok else 1


def measure(options: argparse.Namespace) -> None:
    """Measure a packing; warn where it is sorted by size."""
    from voxgran.io.netcdf import check_statistics_path
    from voxgran.measures.model import measure_registry
    from voxgran.measures.registered.density import main_numbers
    from voxgran.measures.registered.segregation import warning_of

    registry = measure_registry()
    if options.output:
        check_statistics_path(options.output, overwrite=options.overwrite)
    packing = loaded(options)
    tree = voxgran.measure(packing, which=options.which or None)
    last = str(options.output or "")
    asked = [name for name in registry.names() if name in (options.which or ())]
    if options.output:
        voxgran.save_statistics(tree, options.output, overwrite=options.overwrite)
    elif arrays := [name for name in asked if "/" not in registry.get(name).groups]:
        last = f"of {', '.join(arrays)} there are arrays only: write them with -o FILE.nc or FILE.csv"
    found = {str(name): value for name, value in tree.dataset.data_vars.items() if value.ndim == 0}
    units = {name: str(value.attrs.get("units", "1")) for name, value in found.items() if name not in UNITS}
    numbers = {name: value.item() for name, value in found.items()}
    if "solid_fraction" in numbers:
        # those of the tree are of the container
        numbers = {**(known := main_numbers(packing, tree)), **numbers, **known}
    for vectors in tree["/fabric"].to_dataset()["vector"].values.tolist() if "fabric" in asked else ():
        numbers[f"fabric_tensor_of_{vectors}"] = (
            tree["/fabric"].to_dataset()["second_order"].sel(vector=vectors).values.tolist()
        )
    show(numbers, options, last, units)
    if "segregation" in tree and (warning := warning_of(float(tree["segregation"]), int(tree["count"]))):
        complain(f"warning: {warning}")


def _fields(source: Any, *names: str) -> dict[str, Any]:
    """Return attributes by their names."""
    return {name: getattr(source, name) for name in names}


def report(options: argparse.Namespace) -> None:
    """Write a page about a packing."""
    from voxgran.report.page import check_page_path

    target = Path(options.output or Path(options.file).with_suffix(".html"))
    check_page_path(target, overwrite=options.overwrite)
    packing = loaded(options)
    with progress(options) as on_step:
        proof = voxgran.verify(packing, on_step=on_step)
    given = _fields(options, "color_by", "turntable", "interactive", "overwrite")
    voxgran.save_report(packing, target, statistics=voxgran.measure(packing), verification=proof, **given)
    print(target)


def compare(options: argparse.Namespace) -> None:
    """Write a page that compares packings."""
    from voxgran.report.page import check_page_path
    from voxgran.scene.replicates import packings_of_run

    check_page_path(options.output, overwrite=options.overwrite)
    packings: dict[str, list[Any]] = {}
    for name, path in _named(options.file):
        given = packings_of_run(path) if Path(path).is_dir() else [voxgran.load(path)]
        for packing in given:
            say_assumed(packing, f"{path}: ")
        packings.setdefault(name, []).extend(given)
    voxgran.save_comparison(packings, options.output, **_fields(options, "interactive", "overwrite"))
    print(options.output)


def _named(words: Sequence[str]) -> list[tuple[str, str]]:
    """Return name and path of each word ``NAME=PATH`` or ``PATH``.

    A path without a name is called after its file, or its folder where that says more; where two would be called the
    same, each is called by its whole path, so that only a name that was given twice makes a group of both.
    """
    found: list[tuple[str, str]] = []
    for word in words:
        name, mark, path = word.partition("=")
        named = bool(mark and name) and not Path(word).exists()
        found.append((name, path) if named else ("", word))
    plain = [_called(path) for name, path in found if not name]
    given = {name for name, _ in found}
    return [
        (name or (path if plain.count(_called(path)) > 1 or _called(path) in given else _called(path)), path)
        for name, path in found
    ]


def _called(path: str) -> str:
    """Return what a packing is called after its path: its folder where a run has named the file."""
    from voxgran.scene.run import PACKING

    place = Path(path)
    if place.is_dir():
        return place.absolute().name
    return place.absolute().parent.name if place.name == PACKING else place.stem


def repair(options: argparse.Namespace) -> None:
    """Mend a mesh file and say what was done."""
    from voxgran.shapes.formats.mesh_files import read_surface
    from voxgran.shapes.repairing.diagnose import Remedies
    from voxgran.shapes.repairing.repair import repaired

    if options.output:
        # several bodies are written under names of their own, and looked for when their number is known
        check_surface_output(options.output, overwrite=True)
    points, faces = read_surface(options.file)
    remedies = Remedies(keep_open="", choose="choose with --bodies largest or --bodies all", hole="raise --max-hole")
    made = repaired(
        points, faces, name=Path(options.file).stem, max_hole=options.max_hole, bodies=options.bodies, remedies=remedies
    )
    written = _write_bodies(made.shapes, options) if options.output else []
    numbers: dict[str, Any] = {
        "done": list(made.sentences) or ["nothing: the mesh is good as it is"],
        "bodies": len(made.shapes),
        "faces": sum(len(shape.faces) for shape in made.shapes),
        "volume": made.volume,
        "volume_change": made.volume_change,
        "written": written,
    }
    if options.json:
        show(numbers, options)
        return
    print(*(numbers.pop("done")), sep="\n")
    show(numbers, options)


def cloud(options: argparse.Namespace) -> None:
    """Make a shape of a scanned point cloud and tell how far the two are apart."""
    if options.output:
        check_surface_output(options.output, overwrite=options.overwrite)
    scan = voxgran.load_cloud(options.file)
    given = len(scan)
    if options.outliers is not None:
        scan = scan.without_outliers(options.outliers)
    if options.spacing is not None:
        scan = scan.thinned(options.spacing)
    made = voxgran.shape_of_cloud(scan, method=options.method, max_gap=options.max_gap)
    if options.output:
        voxgran.save_shape(made.shape, options.output, overwrite=options.overwrite)
    numbers = _fields(made, "spacing", "mean_residual", "rms_residual", "largest_residual", "largest_hole")
    numbers |= {"volume": made.shape.volume, "faces": len(made.shape.faces)}
    show({"points": given, "points_used": len(scan), **numbers, "mended": list(made.sentences)}, options)


def _write_bodies(shapes: Sequence[Any], options: argparse.Namespace) -> list[str]:
    """Write each solid to the output, several with a number each."""
    target = Path(options.output)
    names = [target] if len(shapes) == 1 else [target.with_stem(f"{target.stem}_{k}") for k in range(len(shapes))]
    for body, path in zip(shapes, names, strict=True):
        voxgran.save_shape(body, path, overwrite=options.overwrite)
    return [str(path) for path in names]


def methods(options: argparse.Namespace) -> None:
    """List methods, families, sizes, orientations and measures, or a group or one of them, with their parameters.

    Raises
    ------
    UnknownNameError
        If there is nothing of that name; the message gives the nearest one.
    """
    from voxgran.clumps.method import clump_registry
    from voxgran.geometry.orientations import KINDS as TURNS
    from voxgran.measures.model import measure_registry
    from voxgran.packing.method import method_registry
    from voxgran.shapes.family import families
    from voxgran.shapes.sizes import KINDS

    registries: dict[str, Any] = {
        "packing methods": method_registry(),
        "clump methods": clump_registry(),
        "shape families": families(),
        "measures": measure_registry(),
    }
    groups = {title: {name: found.get(name) for name in found.names()} for title, found in registries.items()}
    laws: dict[str, dict[str, Any]] = {"sizes": {**KINDS}, "orientations": {**TURNS}}
    for title, kinds in laws.items():
        groups[title] = {
            name: SimpleNamespace(summary=(law.__doc__ or "").partition(".\n")[0], parameters=law)
            for name, law in sorted(kinds.items())
        }
    chosen = {title: [n for n in found if options.name in (None, n, title)] for title, found in groups.items()}
    named = {title: names for title, names in chosen.items() if names}
    if not named:
        known = [*groups, *(name for found in groups.values() for name in found)]
        raise UnknownNameError(unknown("method, family, distribution or measure", options.name, known))
    if options.json:
        told = {t: {name: _described(groups[t][name]) for name in names} for t, names in named.items()}
        print(json.dumps(named if options.name is None else told, indent=2))
        return
    for title, names in named.items():
        print(title)
        for name in names:
            entry = groups[title][name]
            summary = str(getattr(entry, "summary", ""))
            entry_line(f"  {name}", summary if getattr(entry, "usual", True) else f"{summary}; only on request")
            entry_line("", getattr(entry, "source", ""))
            for item in parameters_of(entry.parameters) if hasattr(entry, "parameters") else ():
                entry_line(f"      {item.name}", parameter_text(item))
        print()
    if options.name is None:
        entry_line("cores", CORES)


def _described(entry: Any) -> dict[str, Any]:
    """Return summary, source and parameters of an entry of a registry, for JSON."""
    items = parameters_of(entry.parameters) if hasattr(entry, "parameters") else ()
    told = {
        item.name: {"doc": item.doc, "type": item.type_text, "unit": item.unit}
        | ({} if item.default is MISSING else {"default": item.default})
        for item in items
    }
    return {"summary": entry.summary, "source": getattr(entry, "source", ""), "parameters": told}


def app(options: argparse.Namespace) -> None:
    """Put scenes together, run them and look at them in a browser."""
    from voxgran.app.serve import serve
    from voxgran.scene.checked_sections import read_toml

    scene = Path(options.file) if options.file else Path(__file__).with_name("scene.toml")
    given = read_toml(scene)
    if not options.file:
        # true shapes that fall, the shortest way to a bed at rest
        given = {**given, "packing": {"method": "gravity", "count": 100}}
        del given["settle"]
    folder = Path(options.output or (scene.parent / "app" if options.file else "app"))
    serve(
        given,
        folder,
        base=scene.parent if options.file else Path.cwd(),
        port=options.port,
        open_browser=not options.no_browser,
        told=lambda address: print(f"open {address}\nCtrl-C ends the app; results are in {folder}", flush=True),
    )


def demo(options: argparse.Namespace) -> int:
    """Pack scanned rocks and random solids, prove, measure, save and show them."""
    from voxgran.scene.demo import run_demo

    told: list[Any] = []

    def tell(row: dict[str, Any]) -> None:
        """Print a row of the table as soon as it is known."""
        table([row], head=not told, least=10)
        told.append(row)

    with progress(options) as on_step:
        on_row = None if options.json else tell
        rows = run_demo(options.output, overwrite=options.overwrite, on_step=on_step, on_row=on_row)
    if options.json:
        print(json.dumps(rows, indent=2))
    else:
        print(f"results in {options.output}: open report.html, or packing.vtp and scene.vtm in ParaView")
    return 0 if all(row["verify"] == "ok" for row in rows) else 1


def data(options: argparse.Namespace) -> None:
    """Copy a file that comes with voxgran, and say where the copy is; without a name, list the files.

    Raises
    ------
    InputError
        If an output is given without a name.
    """
    if options.name is None:
        if options.output:
            names = ", ".join(installed_data_files())
            where = shown(options.output)
            raise InputError(f"-o {where} is given without a name: name the file to copy; one of {names}")
        if options.json:
            show(installed_data_files(), options)
        else:
            for name, about in installed_data_files().items():
                entry_line(name, about)
        return
    source, target = voxgran.data_file(options.name), options.output or options.name
    with written_whole(target, overwrite=options.overwrite) as draft:
        draft.write_bytes(source.read_bytes())
    show({"file": str(target), "bytes": source.stat().st_size}, options)
