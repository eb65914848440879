"""Small jobs whose numbers are compared between versions of the code, processors and settings: each gives arrays."""

import functools
import itertools

import numpy as np

import voxgran as vg
from voxgran.cli import bits
from voxgran.cli.bits import of_clump, of_packing

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


def tilted_jobs():
    """Return jobs of methods in a tilted periodic cell."""
    cell = vg.Box((3.2, 3.2, 4.0), periodic="xyz", tilt=(0.6, 0.2, -0.3))
    return {f"pack {name} in tilted box": packing_job(name, "tilted box", cell) for name in ("rsa", "jam", "compress")}


def family_jobs():
    """Return jobs of all families of shapes: their geometry, and points on it."""

    def job(family):
        def run():
            shape = vg.make_shape(family, seed=3)
            return of_shape(shape) | {"points": np.asarray(vg.sample_surface(shape, spacing=0.2, seed=0))}

        return run

    return {f"family {name}": job(name) for name in vg.shape_families() if name != "learned"}


def of_shape(shape):
    """Return the arrays of a shape."""
    open_surface = type(shape.geometry).__name__ == "Surface"
    numbers = {} if open_surface else {"volume": np.array(shape.volume), "inertia": np.asarray(shape.inertia)}
    return numbers | {"vertices": np.asarray(shape.vertices)}


@functools.cache
def beads():
    """Return a label image of grains that touch, and the segmentation of a grey image of them."""
    packing = vg.pack(
        vg.make_shape("ellipsoid", semi_axes=(0.5, 0.4, 0.35)), vg.Box((3, 3, 3)), "gravity", count=20, seed=2
    )
    labels = np.asarray(vg.to_image(packing, voxel_size=0.08))
    return labels, vg.segment(np.where(labels > 0, 200.0, 40.0) + 0.01 * labels, threshold=100.0)


def image_jobs():
    """Return jobs of images of grains and of shapes that are learned from them."""

    def surfaces():
        shapes = vg.load_labels(beads()[0], voxel_size=0.08)
        return {f"{k}": np.asarray(shape.vertices) for k, shape in enumerate(shapes)}

    def learned():
        model = vg.learn_shapes(vg.load_labels(beads()[0], voxel_size=0.08))
        return {f"{k}": np.asarray(shape.vertices) for k, shape in enumerate(model.sample(3, seed=1))}

    return {
        "segmented labels": lambda: {"labels": np.asarray(beads()[1].labels)},
        "surfaces of labels": surfaces,
        "learned shapes": learned,
    }


def all_jobs():
    """Return all jobs by name."""
    return (
        packing_jobs() | tilted_jobs() | bed_jobs() | compressed_jobs() | clump_jobs() | measured_jobs() | family_jobs()
        | image_jobs() | bits.jobs()
    )  # fmt: skip


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


def compressed_jobs():
    """Return jobs of compressed specimens."""
    start = {"count": 30, "seed": 4, "friction": 0.3}
    sphere, block = vg.make_shape("sphere"), vg.make_shape("convex_polyhedron", seed=3, points=10)
    cell, walls = vg.Box((5, 5, 5), periodic="xyz"), vg.Box((4, 4, 4))
    return {
        "compress spheres": lambda: of_packing(vg.pack(sphere, cell, "compress", **start)),
        "compress polyhedra": lambda: of_packing(vg.pack(block, cell, "compress", **start)),
        "compress between walls": lambda: of_packing(vg.pack(sphere, walls, "compress", **start)),
        "compress unequally": lambda: of_packing(vg.compress(made("jam", "periodic box")(), stress=(1.0, 1.0, 1.5))),
    }


def clump_jobs():
    """Return jobs of clumps."""

    def job(method, family, known):
        def run():
            return of_clump(vg.fit_clump(grain(family, **known), method=method, max_spheres=8, seed=1))

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


#: jobs whose bits are kept: all methods, containers of all kinds, and what else is made
PACKED = (
    *("advancing_front in sphere", "apollonian in disk", "compress in cylinder", "control_point in periodic box"),
    *("deposition in cylinder", "digital in box", "digital in polygon", "digital_fill in mesh"),
    *("digital_rsa in sphere", "expand in periodic rectangle", "gravity in mesh", "gravity in periodic rectangle"),
    *("growth in box", "jam in periodic box", "multilayer in box", "random_apollonian in disk", "rsa in polygon"),
    *("tetrahedral in box", "voronoi_fill in periodic box", "rsa in tilted box", "jam in tilted box"),
    "compress in tilted box",
)


def reference_jobs():
    """Return the jobs whose bits are kept in reference/bits.csv."""
    every = all_jobs()
    # outlines of many corners take as long as all others
    beds = [name for name in bed_jobs() if "mollon_zhao_2d" not in name]
    kinds = (*bits.jobs(), *beds, *compressed_jobs(), *family_jobs(), *image_jobs())
    clumps = [name for k, name in enumerate(clump_jobs()) if k % 5 in (0, 2)]
    measures = [name for name in measured_jobs() if name.endswith(("gravity in cylinder", "jam in periodic box"))]
    return {name: every[name] for name in (*kinds, *(f"pack {name}" for name in PACKED), *clumps, *measures)}
