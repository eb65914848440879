"""Measure what the interactive view adds to a page: view_cost.py FILE.csv [PACKING ...]

Each line is a packing: those saved in files, and spheres and different rough grains on a lattice. Seconds are of the
processor, the smallest of three.
"""

import time
from pathlib import Path

import numpy as np

import voxgran as vg
from benchmarks.model import arguments, write_rows
from voxgran._base.seeds import stream
from voxgran.report import view
from voxgran.report.colors import coloring, colors_of
from voxgran.shapes.tessellate import sphere


def on_lattice(count: int, shapes: list[vg.Shape]) -> vg.Packing:
    """Return grains of diameter 0.9 on a cubic lattice of edge 1."""
    edge = int(np.ceil(count ** (1 / 3)))
    position = np.stack(np.unravel_index(np.arange(count), (edge,) * 3), axis=1) + 0.5
    box = vg.Box((edge,) * 3)
    return vg.Packing.of(
        shapes, box, position=position, scale=np.full(count, 0.9), shape_id=np.arange(count) % len(shapes)
    )


def rough(count: int) -> list[vg.Shape]:
    """Return different shapes of 1,280 triangles."""
    directions, faces, _ = sphere(3)
    generator = stream(1, "rough")
    bumps = 0.5 + 0.05 * generator.random((count, len(directions), 1))
    return [vg.Shape.from_mesh(directions * bump, faces, name=f"rough_{k}") for k, bump in enumerate(bumps)]


def measured(name: str, packing: vg.Packing) -> dict[str, object]:
    """Return seconds and megabytes of the view, without what the measures of a page have found before."""
    for color in colors_of(packing):
        coloring(packing, color)
    seconds = []
    for _ in range(3):
        view.viewer.cache_clear()
        began = time.process_time()
        found = view.views_of({"": packing})
        seconds.append(time.process_time() - began)
    data, library = len(found["packings"][0].data) / 1e6, len(found["viewer"]) / 1e6
    shapes = len(np.unique(packing.shape_id))
    _, arrays = view.view_data(packing, view.shown_grains(packing), max(20, min(1000, view.TRIANGLES // packing.count)))
    drawn = int(arrays["face_count"][arrays["shape"]].sum())
    row = {"packing": name, "grains": packing.count, "shapes": shapes, "triangles": drawn}
    return {**row, "seconds": f"{min(seconds):.2f}", "data_mb": f"{data:.2f}", "plotly_mb": f"{library:.2f}"}


def main() -> None:
    """Write the table."""
    target, files = arguments(__doc__, "file", packings=[])
    cases = {Path(path).parent.name or path: vg.load(path) for path in files}
    cases["spheres"] = on_lattice(1_000, [vg.make_shape("sphere")])
    cases["different grains of 1,280 triangles"] = on_lattice(1_000, rough(1_000))
    cases["many spheres"] = on_lattice(20_000, [vg.make_shape("sphere")])
    cases["more spheres than are shown"] = on_lattice(100_000, [vg.make_shape("sphere")])
    rows = [measured(name, packing) for name, packing in cases.items()]
    write_rows(target, ",".join(rows[0]), [row.values() for row in rows])


if __name__ == "__main__":
    main()
