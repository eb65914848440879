#!/usr/bin/env python3
"""Keep the numbers of small jobs, or compare them: ``same_numbers.py keep FILE.npz [JOB ...]``, ``compare OLD NEW``,
``bits``.

It shows that a change of the code changes no number. The jobs are packings of all methods in all kinds of container,
settled beds, clumps, measures, verification and images. ``compare`` lists the jobs whose bits differ, with the largest
difference in units of the largest value, and ends with status 1 if there are any. ``bits`` writes what tests and
`voxgran doctor` compare results with: tests/reference/bits.csv, and the table in voxgran/cli/bits.py.
"""

import argparse
import importlib.metadata
import json
import re
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np

import voxgran as vg
from voxgran.cli import bits

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from jobs import all_jobs, reference_jobs


def keep(file, wanted):
    """Run the jobs and write what they give, with the CPU seconds of each on standard output."""
    jobs = all_jobs()
    arrays = {}
    for name, job in jobs.items():
        if wanted and not any(word in name for word in wanted):
            continue
        start = time.process_time()
        try:
            with warnings.catch_warnings(action="ignore"):
                result = job()
        except (vg.VoxgranError, ValueError, TypeError) as error:
            result = {"refused": np.array(str(error))}
        arrays |= {f"{name}|{key}": value for key, value in result.items()}
        said = str(result["refused"])[:60] if "refused" in result else ""
        sys.stdout.write(f"{time.process_time() - start:7.2f} s  {name}  {said}\n")
        sys.stdout.flush()
    np.savez_compressed(file, **arrays)


def compare(old, new):
    """Return the number of jobs whose bits differ, and print each."""
    before, after = np.load(old), np.load(new)
    differ = {}
    for key in sorted(set(before.files) | set(after.files)):
        if key not in before.files or key not in after.files:
            differ[key] = "only in one"
            continue
        a, b = before[key], after[key]
        if a.shape == b.shape and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
            continue
        if a.shape != b.shape or a.dtype.kind != "f":
            differ[key] = f"{a.shape} {b.shape} {a.flat[:1]} {b.flat[:1]}"
            continue
        scale = np.nanmax(np.abs(a), initial=1e-300)
        differ[key] = f"{np.nanmax(np.abs(a - b), initial=0.0) / scale:.2e}"
    for key, what in differ.items():
        sys.stdout.write(f"{key}: {what}\n")
    jobs = {key.partition("|")[0] for key in after.files}
    sys.stdout.write(f"{len(jobs)} jobs, {len({key.partition('|')[0] for key in differ})} differ\n")
    return len(differ)


def keep_bits():
    """Write the bits of the reference jobs, with the versions of the libraries that made them."""
    root, found = Path(__file__).resolve().parents[1], {}
    for name, job in reference_jobs().items():
        with warnings.catch_warnings(action="ignore"):
            found[name] = bits.digest(job())
    rows = "".join(f"{name},{digest}\n" for name, digest in found.items())
    (root / "tests" / "reference" / "bits.csv").write_text("job,bits\n" + rows)
    source = root / "voxgran" / "cli" / "bits.py"
    text = source.read_text()
    versions = {name: importlib.metadata.version(name) for name in bits.VERSIONS}
    for table, values in (("VERSIONS", versions), ("REFERENCE", {name: found[name] for name in bits.jobs()})):
        text = re.sub(rf"(?ms)^{table}(: [^=]*)? = {{.*?}}$", rf"{table}\1 = {json.dumps(values)}", text)
    source.write_text(text)
    subprocess.run([sys.executable, "-m", "ruff", "format", "--quiet", str(source)], check=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    tasks = parser.add_subparsers(dest="task", required=True)
    for task, first, second, many in (("keep", "FILE.npz", "JOB", "*"), ("compare", "OLD", "NEW", None)):
        one = tasks.add_parser(task)
        one.add_argument("file", metavar=first)
        one.add_argument("rest", metavar=second, nargs=many)
    tasks.add_parser("bits")
    given = parser.parse_args()
    if given.task == "bits":
        keep_bits()
    elif given.task == "keep":
        keep(given.file, given.rest)
    else:
        sys.exit(min(compare(given.file, given.rest), 1))
