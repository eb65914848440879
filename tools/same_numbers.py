#!/usr/bin/env python3
"""Keep the numbers of small jobs, or compare them: ``same_numbers.py keep FILE.npz [JOB ...]``, ``compare OLD NEW``.

It shows that a change of the code changes no number. The jobs are packings of all methods in all kinds of container,
settled beds, clumps, measures, verification and images. ``compare`` lists the jobs whose bits differ, with the largest
difference in units of the largest value, and ends with status 1 if there are any.
"""

import argparse
import itertools
import sys
import time
import warnings

import numpy as np

import voxgran as vg

#: what makes a method quick here
QUICK = {"sweeps": 60, "cycles": 1, "voxel_size": 0.12, "spacing": 0.25, "orientations": 4}
BOUNDS = np.array([(0, 0), (3, 0), (3, 1.4), (1.4, 1.4), (1.4, 3), (0, 3)])


def containers():
    """Return containers of all kinds by name."""
    corner = vg.ClosedMesh(vg.make_shape("convex_polyhedron", seed=4, points=14, diameter=4.2))
    return {
        "periodic box": vg.Box((3.2, 3.2, 4.0), periodic="xy"),
        "box": vg.Box((3.0, 3.0, 4.0)),
        "cylinder": vg.Cylinder(1.7, 4.0),
        "sphere": vg.Sphere(2.0),
        "mesh": corner,
        "periodic rectangle": vg.Rectangle((5.0, 5.0), periodic="x"),
        "disk": vg.Disk(2.6),
        "polygon": vg.Polygon(2.0 * BOUNDS),
    }


def shapes(dimension, method):
    """Return two shapes of one dimension that a method takes."""
    if dimension == 2:
        return [vg.make_shape("disk", diameter=0.8), vg.make_shape("polygon", corners=5, diameter=0.9)]
    sphere = vg.make_shape("sphere", diameter=0.8)
    if method == "multilayer":
        return [sphere]
    return [sphere, vg.make_shape("convex_polyhedron", seed=3, points=10, diameter=0.9)]


def parameters(method):
    """Return the parameters that make a method quick."""
    from voxgran.packing.method import method_registry

    known = method_registry().get(method).parameters.__dataclass_fields__
    return {key: value for key, value in QUICK.items() if key in known}


def of_packing(packing):
    """Return the arrays of a packing."""
    names = ("shape_id", "scale", "position", "orientation")
    return {name: np.asarray(getattr(packing, name)) for name in names} | {"why": np.array(packing.stop_reason)}


def packing_job(method, name, container):
    """Return the arrays of a packing, or the sentence that refuses it."""
    own = shapes(container.dimension, method)
    own = own[:1] if method == "apollonian" else own
    extra = {"count": 14} | ({"solid_fraction": 0.3} if method == "expand" else {})
    if method == "multilayer":
        extra = {}
    return lambda: of_packing(vg.pack(own, container, method, seed=5, **extra, **parameters(method)))


def packing_jobs():
    """Return jobs of all methods in all containers."""
    everything = itertools.product(vg.packing_methods(), containers().items())
    return {f"pack {method} in {name}": packing_job(method, name, place) for method, (name, place) in everything}


GRAINS = {
    "sphere": {},
    "ellipsoid": {"axes": (1.0, 0.8, 0.6)},
    "box": {},
    "cylinder": {},
    "spherocylinder": {},
    "convex_polyhedron": {"points": 12},
    "superquadric": {},
    "solid_union": {"solids": 3},
    "sphere_assembly": {"spheres": 4},
    "torus": {},
}
FLAT_GRAINS = ("disk", "polygon", "mollon_zhao_2d")


def grain(family, **known):
    """Return a shape of a family, with the parameters that it knows."""
    try:
        return vg.make_shape(family, seed=2, **known)
    except (TypeError, ValueError):
        return vg.make_shape(family, seed=2)


def bed_jobs():
    """Return jobs of settled beds."""
    places = {name: place for name, place in containers().items() if name in ("periodic box", "cylinder", "mesh")}

    def job(family, known, place):
        def run():
            loose = vg.pack([grain(family, **known)], place, "rsa", count=16, seed=7, sizes=vg.sizes.uniform(0.6, 0.9))
            return of_packing(vg.settle(loose, friction=0.3, gravity="-z" if place.dimension == 3 else "-y"))

        return run

    jobs = {
        f"settle {family} in {name}": job(family, known, place)
        for family, known in GRAINS.items()
        for name, place in list(places.items())[:: 1 if family in ("sphere", "convex_polyhedron") else 3]
    }
    flat = {name: place for name, place in containers().items() if place.dimension == 2}
    jobs |= {
        f"settle {family} in {name}": job(family, {}, place)
        for family in FLAT_GRAINS
        for name, place in list(flat.items())[:: 1 if family == "disk" else 2]
    }
    return jobs


def clump_jobs():
    """Return jobs of clumps."""

    def job(method, family, known):
        def run():
            clump = vg.fit_clump(grain(family, **known), method=method, max_spheres=8, seed=1)
            return {"centers": clump.centers, "radii": clump.radii}

        return run

    solids = {key: GRAINS[key] for key in ("convex_polyhedron", "solid_union", "cylinder", "torus")}
    everything = itertools.product(vg.clump_methods(), solids.items())
    return {f"clump {method} of {family}": job(method, family, known) for method, (family, known) in everything}


def of_datasets(*datasets):
    """Return the numbers of datasets by their number and name; times are none of them."""
    values = {
        f"{k}:{name}": np.asarray(value) for k, one in enumerate(datasets) for name, value in one.data_vars.items()
    }
    return {name: value for name, value in values.items() if value.dtype.kind in "fiub" and "seconds" not in name}


def measured_jobs():
    """Return jobs of measures, proofs, equilibria and images of packings."""
    kinds = [
        ("gravity", "periodic box"),
        ("gravity", "cylinder"),
        ("rsa", "box"),
        ("rsa", "mesh"),
        ("jam", "periodic box"),
    ]
    kinds += [("gravity", "periodic rectangle"), ("rsa", "disk"), ("deposition", "cylinder"), ("rsa", "polygon")]
    kinds += [("advancing_front", "sphere")]
    jobs = {}
    for method, name in kinds:
        make = made(method, name)
        jobs[f"measure {method} in {name}"] = lambda make=make: of_datasets(*vg.measure(make()).subtree)
        jobs[f"verify {method} in {name}"] = lambda make=make: of_proof(make())
        jobs[f"image {method} in {name}"] = lambda make=make: {
            "labels": np.asarray(vg.to_image(make(), voxel_size=0.1))
        }
        if method == "gravity":
            jobs[f"equilibrium {method} in {name}"] = lambda make=make: of_datasets(vg.equilibrium(make()))
    return jobs


def made(method, name):
    """Return a function that packs."""
    place = containers()[name]
    own = shapes(place.dimension, method)[: 1 if method == "deposition" else 2]
    return lambda: vg.pack(own, place, method, count=24, seed=9)


def of_proof(packing):
    """Return the gaps of a packing and what verification says."""
    proof = vg.verify(packing)
    contacts = packing.contacts(0.2)
    arrays = {
        name: np.asarray(getattr(contacts, name)) for name in ("first", "second", "gap") if hasattr(contacts, name)
    }
    return arrays | {"deepest": np.array(proof.deepest), "ok": np.array(proof.ok)}


def keep(file, wanted):
    """Run the jobs and write what they give, with the CPU seconds of each on standard output."""
    jobs = packing_jobs() | bed_jobs() | clump_jobs() | measured_jobs()
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    tasks = parser.add_subparsers(dest="task", required=True)
    for task, first, second, many in (("keep", "FILE.npz", "JOB", "*"), ("compare", "OLD", "NEW", None)):
        one = tasks.add_parser(task)
        one.add_argument("file", metavar=first)
        one.add_argument("rest", metavar=second, nargs=many)
    given = parser.parse_args()
    if given.task == "keep":
        keep(given.file, given.rest)
    else:
        sys.exit(min(compare(given.file, given.rest), 1))
