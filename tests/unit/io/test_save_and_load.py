"""`save` and `load` choose the format by the suffix."""

import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.io.files import load, save


@pytest.mark.parametrize("name", ["p.vtp", "p.txt", "p.xyzr", "p.csv", "P.VTP"])
def test_every_suffix_makes_a_round_trip(spheres, name, tmp_path):
    save(spheres, tmp_path / name)
    # a table that pandas reads has no room for container and unit
    again = load(tmp_path / name, **({"container": spheres.container, "unit": "mm"} if name == "p.csv" else {}))
    assert again.position.tobytes() == spheres.position.tobytes()
    assert again.container == spheres.container
    assert again.unit == "mm"


def test_an_unknown_suffix_names_the_known_ones(spheres, tmp_path):
    with pytest.raises(FileFormatError, match=r"suffix '.stl': packings are kept as .vtp, .txt, .xyzr, .csv"):
        save(spheres, tmp_path / "p.stl")
    with pytest.raises(InputError, match="path is 3: it must be the path of a file"):
        save(spheres, 3)
    with pytest.raises(InputError, match="path is None"):
        load(None)
    with pytest.raises(InputError, match="packing is 'spheres': it must be a Packing"):
        save("spheres", tmp_path / "p.vtp")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "p.bin").write_bytes(b"\0" * 100)
    with pytest.raises(FileFormatError, match=r"suffix '.bin' and no known content: .* LAMMPS"):
        load(tmp_path / "p.bin")


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_meshes_of_all_grains_have_a_way(suffix, tmp_path):
    bed = vg.Packing.of(vg.shapes.box(lengths=(1, 1, 1)), vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])
    path = tmp_path / f"bed{suffix}"
    with pytest.raises(FileFormatError, match=r"or write the surfaces of all grains by packing") as caught:
        vg.save(bed, path)
    eval(str(caught.value).rpartition(" by ")[2], {"packing": bed})
    assert [shape.volume for shape in vg.repair(path, bodies="all").shapes] == pytest.approx([1, 1])
    # where no mesh is meant, none is offered
    with pytest.raises(FileFormatError, match=r"choose one of these$"):
        vg.save(bed, tmp_path / "bed.xyz")


def test_the_shape_of_a_grain_is_not_called_the_grain(tmp_path):
    bed = vg.Packing.of(vg.shapes.box(lengths=(1, 1, 1)), vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])
    with pytest.raises(InputError, match=r"not at its size and place; packing\[\[k\]\]"):
        vg.save_shape(bed[1], tmp_path / "grain.stl")
    assert bed[[1]].to_pyvista().center == pytest.approx((3, 3, 3))
