"""Measure what fewer triangles cost and save: simplify_cost.py FILE.csv

Each line is a scan with so many triangles: seconds and errors of the simplification, and seconds, solid fraction and
share at rest of a bed of 100 such grains by ``gravity``. Seconds are CPU seconds, after a first call.
"""

import time

import voxgran as vg
from benchmarks.model import arguments, write_rows

SCANS = {"eros": "eros.obj", "itokawa": "itokawa_lp.obj"}
FACES = (200, 500, 1000, 2000, 5000)
GRAINS = 100


def bed_of(shape: vg.Shape) -> tuple[float, vg.Packing]:
    """Return the seconds of a bed, and the bed."""
    grain = shape.scaled(1 / shape.diameter)
    began = time.process_time()
    bed = vg.pack(grain, vg.Box((4, 4, 20)), "gravity", count=GRAINS, seed=1)
    return time.process_time() - began, bed


def row_of(name: str, scan: vg.Shape, faces: int | None) -> dict[str, object]:
    """Return a line of the table; of the scan itself where `faces` is None."""
    row: dict[str, object] = {"scan": name, "faces": len(scan.faces), "seconds": "", "collapse_volume_change": ""}
    row.update(mean_distance="", largest_distance="")
    shape = scan
    if faces is not None:
        began = time.process_time()
        made = vg.simplify(scan, faces=faces)
        row["seconds"] = f"{time.process_time() - began:.2f}"
        row.update(faces=made.faces, collapse_volume_change=f"{made.collapse_volume_change:.1e}")
        row["mean_distance"] = f"{made.mean_distance / scan.diameter:.1e}"
        row["largest_distance"] = f"{made.largest_distance / scan.diameter:.1e}"
        shape = made.shape
    seconds, bed = bed_of(shape)
    row["bed_seconds"] = f"{seconds:.2f}"
    row["solid_fraction"] = f"{float(vg.measure(bed, 'density')['/'].bed_solid_fraction):.3f}"
    row["at_rest"] = f"{bed.forces.share_at_rest:.3f}" if bed.forces is not None else ""
    return row


def main() -> None:
    """Write the table."""
    [target] = arguments(__doc__, "file")
    rows = []
    for name, file in SCANS.items():
        scan = vg.load_shape(vg.data_file(file))
        bed_of(vg.simplify(scan, faces=FACES[0]).shape)
        rows += [row_of(name, scan, faces) for faces in (*FACES, None) if (faces or 0) < len(scan.faces)]
    write_rows(target, ",".join(rows[0]), [row.values() for row in rows])


if __name__ == "__main__":
    main()
