"""The public names: one table, with the types, completion and documentation that users get of it."""

import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import voxgran as vg
from voxgran._base.arrays import as_number
from voxgran._base.config import parameter
from voxgran._base.errors import CallError, InputError, UnknownNameError
from voxgran._base.seeds import stream
from voxgran._base.stopping import stop_if_asked
from voxgran.decks.engine import Engine
from voxgran.geometry.rotation import random_rotations
from voxgran.packing.method import Cost, PackingMethod, State
from voxgran.study.result import StudyResult
from voxgran.testing import PackingMethodSuite

PACKAGE = Path(vg.__file__).parent
NAMESPACES = [vg.containers, vg.clumps, vg.methods, vg.families]


def test_stubs_have_the_types_of_the_parameter_classes():
    root = PACKAGE.parent
    command = [sys.executable, root / "tools" / "stubs.py", "--check"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": f"{root}"}
    )
    assert done.returncode == 0, done.stderr


def test_every_name_of_a_namespace_is_there():
    for namespace in NAMESPACES:
        assert namespace.__all__
        assert all(getattr(namespace, name).__module__.startswith("voxgran.") for name in namespace.__all__)
        assert dir(namespace) == namespace.__all__
        with pytest.raises(AttributeError, match="no_such_name"):
            namespace.no_such_name  # noqa: B018
    assert vg.containers.Box is vg.Box
    assert {name.lower() for name in vg.methods.__all__} == {name.replace("_", "") for name in vg.packing_methods()}
    assert {name.lower() for name in vg.families.__all__} == {name.replace("_", "") for name in vg.shape_families()}
    assert dir(vg.shapes) == list(vg.shape_families())


@pytest.mark.parametrize("name", ["deform", "measure", "plot", "verify", "shapes", "clumps", "containers", "methods"])
def test_a_name_stays_what_it_is(name):
    # importing a module binds its name in the package above it
    code = f"import voxgran as vg, inspect; a = vg.{name}; b = vg.{name}; assert a is b and inspect.ismodule(a) == "
    kind = name in {"shapes", "clumps", "containers", "methods"}
    subprocess.run([sys.executable, "-c", code + str(kind)], check=True)


@pytest.mark.parametrize("name", [name for name in dir(vg) if inspect.isfunction(inspect.unwrap(getattr(vg, name)))])
def test_every_argument_of_a_function_is_documented(name):
    function = getattr(vg, name)
    names = inspect.signature(function).parameters
    listed = re.search(r"\nParameters\n-+\n(.*?)(\n\n[A-Z][A-Za-z ]+\n---|$)", inspect.getdoc(function) or "", re.S)
    # a line that is not indented has the names before the colon
    lines = re.findall(r"^(\S[^:\n]*)", listed[1] if listed else "", re.M)
    assert set(names) <= {one.strip(" *") for line in lines for one in line.split(",")}


def test_help_shows_parameters():
    text = vg.methods.Digital.__doc__
    assert "Parameters\n    ----------\n    " in text
    assert "\n    voxel_size : a number above 0, optional\n" in text
    assert text.index("Parameters") < text.index("Raises")
    assert "semi_axes" in vg.shapes.ellipsoid.__doc__
    assert list(inspect.signature(vg.shapes.random_surface).parameters)[-1] == "seed"
    assert "seed" not in inspect.signature(vg.shapes.sphere).parameters


def test_methods_are_chosen_by_parameter_objects():
    box, shape = vg.Box((3, 3, 3)), vg.shapes.sphere(radius=0.5)
    by_name = vg.pack(shape, box, method="rsa", count=4, tries=50)
    assert vg.pack(shape, box, vg.methods.Rsa(tries=50), count=4) == by_name
    assert vg.pack(shape, box, method=vg.methods.Rsa(tries=50), count=4).provenance["method"] == "rsa"
    assert vg.make_shape(vg.families.Sphere(diameter=1.0)) == shape == vg.make_shape("sphere", radius=0.5)
    fitted = vg.fit_clump(shape, method=vg.clumps.Optimal(), max_spheres=1)
    assert (fitted.radii == vg.fit_clump(shape, max_spheres=1).radii).all()


def test_wrong_choices_are_explained():
    box, shape = vg.Box((3, 3, 3)), vg.shapes.sphere()
    with pytest.raises(InputError, match=r"given beside it: .*write Rsa\(tries=...\)"):
        vg.pack(shape, box, vg.methods.Rsa(), tries=50)
    with pytest.raises(InputError, match=r"write Rsa\(\)"):
        vg.pack(shape, box, vg.methods.Rsa)
    with pytest.raises(InputError, match="is of none of advancing_front"):
        vg.pack(shape, box, vg.families.Sphere())
    with pytest.raises(InputError, match="tries is 'many'"):
        vg.pack(shape, box, vg.methods.Rsa(tries="many"))
    with pytest.raises(UnknownNameError, match="did you mean 'count'"):
        vg.pack(shape, box, "rsa", cuont=3)
    with pytest.raises(CallError, match="needs method"):
        vg.pack(shape, box)
    with pytest.raises(InputError, match="diameter and radius are both given"):
        vg.shapes.sphere(radius=1, diameter=2)
    with pytest.raises(UnknownNameError, match="radius"):
        vg.shapes.sphere(raduis=1)
    with pytest.raises(CallError, match=r"did you mean 'voxel_size'.*write Digital\("):
        vg.methods.Digital(voxelsize=0.1)
    with pytest.raises(CallError, match="by position"):
        vg.clumps.Inscribed(2)
    with pytest.raises(UnknownNameError, match="did you mean 'max_spheres'"):
        vg.fit_clump(shape, spheres=5)


USERS_CODE = """
from typing import Any

import numpy as np
import voxgran as vg

box = vg.containers.Box((4, 4, 4), periodic="xyz")
grain = vg.shapes.sphere(radius=0.5)
brick = vg.shapes.box(lengths=[1, 2, 3]), vg.shapes.sphere(radius=np.float64(2))
blobs = vg.shapes.ellipsoid(semi_axes=np.ones(3)), vg.make_shape("ellipsoid", semi_axes=np.ones(3))
tile = vg.shapes.polygon(vertices=[[0, 0], [1, 0], [0, 1]]), vg.shapes.polygon(vertices=np.eye(3)[:, :2])
rock = vg.make_shape("solid_union", solids=[3, 6], seed=2)
rocks: list[vg.Shape] = vg.make_shapes("convex_polyhedron", count=3, points=(8, 20), seed=1)
bed = vg.pack([grain], box, vg.methods.Digital(voxel_size=0.1), count=20, seed=1)
again = vg.pack(grain, box, "digital", count=20, voxel_size=0.1)
names, counts = ["digital", "rsa"], np.arange(3)
beds = [vg.pack(grain, box, name, count=counts[0], density=np.float32(2.6), unit="mm") for name in names]
sizes = vg.sizes.lognormal(median=1.0, sigma=0.2)
settings: dict[str, Any] = {"tries": 50}
vg.pack([grain, rock], box, method="rsa", sizes=sizes, weights=[1, 2], start=bed, **settings)
vg.pack([grain, rock], box, method="digital", solid_fraction=0.2, weights=np.ones(2), gravity=(0, 0, -1), cycles=None)
clump = vg.fit_clump(rock, max_spheres=counts[1], min_radius=0.1)
listed = vg.pack(grains={"diameter": [1.0]}, container=box, method="gravity", friction=0.2)
number: int = len(bed[bed.diameter > 0.5] + again)
vg.measure(bed, "density"), bed.measure("density"), vg.measure(bed, which=["density"])
print(bed[0].shape, bed.verify().ok, [one.diameter for one in bed], number, vg.make_shape(names[0]), clump.radii)
"""
#: a mistake in a call, and a word of what mypy says
MISTAKES = {
    "vg.pack(grain, box, vg.methods.Rsa(), cuont=3)": "cuont",
    "vg.pack(grain, box, vg.methods.Rsa(), count='3')": "pack",
    "vg.pack(grain, box, 'digital', cuont=3)": "cuont",
    "vg.pack(grain, box, method='digital', count=3, voxel_sise=0.1)": "voxel_sise",
    "vg.pack(grain, box, 'rsa', voxel_size=0.1)": "pack",
    "vg.pack(grain, box, 'rsa', scheme='5')": "pack",
    "vg.pack(grains={'diameter': [1]}, container=box, method='gravity', frictoin=0.2)": "frictoin",
    "vg.make_shape('sphere', raduis=1)": "raduis",
    "vg.fit_clump(grain, smalest=1)": "smalest",
    "vg.methods.Digital(voxle_size=0.1)": "voxle_size",
    "vg.methods.Digital(voxel_size='0.1')": "voxel_size",
    "vg.shapes.sphere(raduis=1)": "raduis",
    "vg.shapes.box(lengths='3')": "lengths",
    "vg.shapes.box(lengths=3)": "lengths",
    "vg.pack(grain, box, 'control_point', contact='points')": "pack",
    "bed.plot(color_by='taste')": "color_by",
    "vg.plot(grain, color_by='taste')": "color_by",
    "vg.measure(bed, 2)": "measure",
    "vg.measure(bed, wich=['density'])": "wich",
    "vg.no_such_name": "no_such_name",
}


# the types of the parameters are those of the stubs, which the next tests compare
@pytest.mark.slow
def test_mypy_finds_mistakes_and_passes_what_is_right(tmp_path):
    pytest.importorskip("mypy")
    assert (PACKAGE / "py.typed").is_file()
    code = tmp_path / "code.py"
    code.write_text(USERS_CODE + "\n".join(MISTAKES) + "\n")
    root = PACKAGE.parent
    command = [sys.executable, "-m", "mypy", "--config-file", root / "pyproject.toml", "--no-error-summary", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=root)
    first = USERS_CODE.count("\n") + 1
    found = {}
    for line in done.stdout.splitlines():
        # mypy keeps the errors of the same code, with the folder of a former run
        place, _, rest = line.partition("/code.py:")
        if tmp_path.name in place and ": error:" in rest:
            number, text = rest.split(": error: ", 1)
            found[int(number)] = found.get(int(number), "") + text
    assert sorted(found) == list(range(first, first + len(MISTAKES))), done.stdout
    assert all(word in text for word, (_, text) in zip(MISTAKES.values(), sorted(found.items()), strict=True)), found


#: classes whose public methods have examples, beside themselves
NOUNS = [
    *(vg.Box, vg.Cloud, vg.ClosedMesh, vg.Cylinder, vg.Disk, vg.Packing, vg.Polygon, vg.Rectangle),
    *(vg.Scene, vg.Series, vg.Shape, vg.Sphere, vg.Study, vg.clumps.Clump, StudyResult),
]
#: what docs/contribute/extending.md says that methods and engines of others use
FOR_EXTENSIONS = [
    *(Cost, Engine, PackingMethod, PackingMethodSuite, State),
    *(as_number, parameter, random_rotations, stop_if_asked, stream),
]


def documented_names():
    """Return each public function, class and method under its name."""
    namespaces = {"voxgran": vg, "voxgran.sizes": vg.sizes, "voxgran.shapes": vg.shapes}
    namespaces.update({space.__name__: space for space in NAMESPACES})
    found = {}
    for title, space in namespaces.items():
        for name in dir(space):
            thing = getattr(space, name)
            # the module of sizes is a file, with names that it imports
            own = space is not vg.sizes or getattr(thing, "__module__", "") == vg.sizes.__name__
            if own and name[0] != "_" and (inspect.isfunction(thing) or inspect.isclass(thing)):
                found[f"{title}.{name}"] = thing
    found.update({thing.__name__: thing for thing in FOR_EXTENSIONS})
    for cls in NOUNS:
        found[cls.__name__] = cls
        for name in dir(cls):
            thing = inspect.getattr_static(cls, name)
            thing = getattr(thing, "__func__", thing)
            if not name.startswith("_") and inspect.isfunction(thing):
                found[f"{cls.__name__}.{name}"] = thing
    return found


def is_error(thing):
    return inspect.isclass(thing) and issubclass(thing, Exception)


def test_help_names_types_as_written():
    # NumPy's alias of what becomes an array is shown as six lines of its private types, unless it is quoted
    signatures = {
        name: str(inspect.signature(thing)) for name, thing in documented_names().items() if not is_error(thing)
    }
    assert not [name for name, text in signatures.items() if "_array_like" in text]
    assert "weights: 'ArrayLike | None' = None" in signatures["voxgran.pack"]


def last_section(documentation):
    """Return the name and the text of the last section of a docstring."""
    lines = inspect.cleandoc(documentation or "").splitlines()
    heads = [k for k in range(len(lines) - 1) if lines[k] and re.fullmatch("-+", lines[k + 1])]
    return (lines[heads[-1]], "\n".join(lines[heads[-1] + 2 :])) if heads else ("", "")


def lacks_examples(documentation):
    """Return whether a docstring does not end with a section of examples that are code and do more than import."""
    head, text = last_section(documentation)
    return head != "Examples" or not re.search(r"^>>> (?!import |from )", text, re.MULTILINE)


def test_all_that_is_public_has_examples():
    names = documented_names()
    assert len(names) > 270
    assert [name for name, thing in names.items() if lacks_examples(thing.__doc__)] == []


def test_what_lacks_examples_is_found():
    head = "Return it.\n\n    Examples\n    --------\n"
    assert not lacks_examples(f"{head}    >>> f(1)\n    2\n    ")
    assert lacks_examples(None)
    assert lacks_examples("Return it.")
    assert lacks_examples(f"{head}    Call it with f(1).\n    ")
    assert lacks_examples(f"{head}    >>> import voxgran as vg\n    f(1)\n    ")
    assert lacks_examples(f"{head}    >>> f(1)\n\n    Raises\n    ------\n    InputError\n        If not.\n    ")
