"""Measure first calls where the wheel is installed: PYTHON_OF_THAT_ENVIRONMENT first_calls.py FILE.csv

Each call is made by processes of its own, on one thread, with an empty cache: one that compiles its kernels, since it
asks for those of this very processor, one that takes what has come with the package, and the last again. Seconds are of
the processor, from the start of Python on, so that the import of libraries is included.
"""

import argparse
import csv
import os
import resource
import subprocess
import sys
import tempfile

from llvmlite.binding import get_host_cpu_name

BOX = "box = vg.Box((4, 4, 8), periodic='xy'); loose = {'count': 60, 'seed': 1, 'settle': False}"
BED = "bed = vg.load('bed.vtp')"
#: calls, by what they are named in the table
CALLS = {
    "gravity, spheres": "vg.pack(vg.shapes.sphere(), box, 'gravity', count=60, seed=1)",
    "gravity, polyhedra": "vg.pack(vg.make_shape('convex_polyhedron'), box, 'gravity', count=60, seed=1)",
    "gravity, rocks": "vg.pack(vg.make_shape('solid_union'), box, 'gravity', count=30, seed=1)",
    "digital": "vg.pack(vg.make_shape('solid_union'), box, 'digital', **loose)",
    "control_point": "vg.pack(vg.make_shape('solid_union'), box, 'control_point', **loose)",
    "rsa": "vg.pack(vg.shapes.sphere(), box, 'rsa', count=60, seed=1)",
    "voxelize": "vg.voxelize(vg.make_shape('solid_union'), voxel_size=0.05)",
    "fit_clump": "vg.fit_clump(vg.make_shape('solid_union'), max_spheres=10)",
    "measure": f"{BED}; bed.measure()",
    "report": f"{BED}; vg.save_report(bed, 'report.html', overwrite=True)",
}
#: words of the prompt, whose helps need no kernels
PROMPTS = ("--version", "--help", "settle --help")
#: the same compiled and from the wheel before kernels were compiled once and imports were late, at commit 4c82b026
BEFORE = {
    "gravity, spheres": (13.1, 1.5),
    "gravity, polyhedra": (20.2, 1.8),
    "gravity, rocks": (30.5, 2.3),
    "digital": (12.1, 1.8),
    "control_point": (34.7, 2.2),
    "rsa": (5.6, 1.5),
    "voxelize": (2.1, 1.1),
    "fit_clump": (8.2, 1.7),
    "measure": (10.5, 2.5),
    "report": (18.8, 6.7),
    "voxgran --version": ("", 0.57),
    "voxgran --help": ("", 0.47),
    "voxgran settle --help": ("", 0.49),
}
MAKE = "vg.save(vg.pack(vg.make_shape('convex_polyhedron'), vg.Box((6, 6, 9)), 'gravity', count=200), 'bed.vtp')"
#: prints how many kernels were compiled
COUNTED = """
import warnings
warnings.simplefilter("ignore")
from voxgran._base.kernels import telling_of_compilation
import voxgran as vg
compiled = []
with telling_of_compilation(lambda: compiled.append(1)):
    {box}
    {call}
print(len(compiled))
"""


def seconds_of(words: list[str], folder: str, cache: str, **environment: str) -> tuple[float, str]:
    """Return the CPU seconds that Python takes with some words in a new process, and what it prints."""
    kept = {**os.environ, "VOXGRAN_CACHE": cache, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", **environment}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *words], cwd=folder, env=kept, check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, done.stdout


def rows(folder: str) -> list[dict[str, object]]:
    """Return what each call takes."""
    calls = {name: ["-c", COUNTED.format(box=BOX, call=call)] for name, call in CALLS.items()}
    prompts = {f"voxgran {words}": ["-m", "voxgran", *words.split()] for words in PROMPTS}
    made = []
    seconds_of(["-c", COUNTED.format(box=BOX, call=MAKE)], folder, tempfile.mkdtemp(dir=folder))
    for name, words in (calls | prompts).items():
        native, packaged = tempfile.mkdtemp(dir=folder), tempfile.mkdtemp(dir=folder)
        compiled, kernels = seconds_of(words, folder, native, NUMBA_CPU_NAME=get_host_cpu_name())
        first, left = seconds_of(words, folder, packaged)
        again, _ = seconds_of(words, folder, packaged)
        earlier = BEFORE[name]
        made.append(
            {
                "call": name,
                "kernels": int(kernels) if name in calls else 0,
                "compiled_seconds": round(compiled, 1) if name in calls else "",
                "compiled_before_seconds": earlier[0],
                "from_the_wheel_seconds": round(first, 2),
                "from_the_wheel_before_seconds": earlier[1],
                "second_process_seconds": round(again, 2),
                "compiled_in_spite_of_the_wheel": int(left) if name in calls else 0,
            }
        )
    return made


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", metavar="FILE.csv")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        table = rows(folder)
    with open(given.file, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, table[0])
        writer.writeheader()
        writer.writerows(table)
