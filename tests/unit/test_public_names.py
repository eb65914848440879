"""The public names: one table, with the types, completion and documentation that users get of it."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import voxgran as vg
from voxgran._base.errors import CallError, InputError, UnknownNameError
from voxgran.packing.pack import pack
from voxgran.shapes.family import families

PACKAGE = Path(vg.__file__).parent
NAMESPACES = [vg.containers, vg.clumps, vg.methods, vg.families]
HEAD = '''"""Functions that make shapes, one for each family of `voxgran.shapes.families`."""

from typing import Literal

from voxgran.shapes.families.solid_union import Kind
from voxgran.shapes.model import Shape as Shape

'''


def shapes_stub():
    """Return the stub of `voxgran.shapes`, from the parameter classes of the families."""
    lines = []
    for name in families().names():
        entry = families().get(name)
        fields = []
        for cls in reversed(entry.parameters.__mro__[:-1]):
            tree = ast.parse(Path(inspect.getfile(cls)).read_text())
            source = next(node for node in tree.body if getattr(node, "name", "") == cls.__name__)
            fields += [node for node in source.body if isinstance(node, ast.AnnAssign)]
        words = [
            f"{f.target.id}: {ast.unparse(f.annotation)}" + "".join(f" = {ast.unparse(a)}" for a in f.value.args)
            for f in fields
        ]
        words = sorted([*words, *(["seed: int = 0"] if entry.random else [])], key=lambda word: " = " in word)
        lines.append(f"def {name}(*, {', '.join(words)}) -> Shape: ...\n")
    return HEAD + "".join(lines)


def test_the_functions_of_shapes_have_the_types_of_the_families():
    found = ast.unparse(ast.parse((PACKAGE / "shapes" / "__init__.pyi").read_text()))
    assert found == ast.unparse(ast.parse(shapes_stub())), f"run 'python {__file__}' and 'ruff format' anew"


def test_the_table_spells_out_the_signature_of_pack():
    tree = ast.parse((PACKAGE / "__init__.pyi").read_text())
    stubs = [node.args for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "pack"]
    true = inspect.signature(pack).parameters
    named = [name for name, item in true.items() if item.kind is not item.VAR_KEYWORD]
    assert [[item.arg for item in (*args.args, *args.kwonlyargs)] for args in stubs] == [named, named]
    assert [args.kwarg is None for args in stubs] == [True, False]


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


def test_former_names_warn():
    with pytest.warns(DeprecationWarning, match="read_image is now voxgran.load_image"):
        assert vg.read_image is vg.load_image


def test_help_shows_parameters():
    text = vg.methods.Digital.__doc__
    assert "Parameters\n    ----------\n    voxel_size : a number, optional\n" in text
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
    fitted = vg.fit_clump(shape, method=vg.clumps.Inscribed(), max_spheres=1)
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


USERS_CODE = """
import voxgran as vg

box = vg.containers.Box((4, 4, 4), periodic="xyz")
grain = vg.shapes.sphere(radius=0.5)
bed = vg.pack([grain], box, vg.methods.Digital(voxel_size=0.1), count=20, seed=1)
again = vg.pack(grain, box, "digital", count=20, voxel_size=0.1)
number: int = len(bed[bed.diameter > 0.5] + again)
print(bed[0].shape, bed.verify().ok, [one.diameter for one in bed], number)
"""
MISTAKES = {
    "vg.pack(grain, box, vg.methods.Rsa(), cuont=3)": "pack",
    "vg.pack(grain, box, vg.methods.Rsa(), count='3')": "pack",
    "vg.methods.Digital(voxle_size=0.1)": "voxle_size",
    "vg.methods.Digital(voxel_size='0.1')": "voxel_size",
    "vg.shapes.sphere(raduis=1)": "raduis",
    "vg.measure(bed, wich=['density'])": "wich",
    "vg.no_such_name": "no_such_name",
}


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
        if line.startswith(str(code)) and ": error:" in line:
            number, text = line.removeprefix(f"{code}:").split(": error: ", 1)
            found[int(number)] = text
    assert sorted(found) == list(range(first, first + len(MISTAKES))), done.stdout
    assert all(word in text for word, (_, text) in zip(MISTAKES.values(), sorted(found.items()), strict=True)), found


if __name__ == "__main__":
    (PACKAGE / "shapes" / "__init__.pyi").write_text(shapes_stub())
