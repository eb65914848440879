import pytest
from kit import references

from benchmarks.packing.dice import METHODS, PUBLISHED, Bed, measure_beds, write_beds


def test_published_values_are_those_of_the_references():
    values = references("non_spherical")
    loose, shaken = values["platonic_dice_loose"], values["platonic_dice_shaken"]
    for solid, found in PUBLISHED.items():
        short = solid.removesuffix("hedron")
        assert found == (loose[short], shaken[short])


@pytest.mark.parametrize(
    "method", ["gravity", *(pytest.param(name, marks=pytest.mark.slow) for name in METHODS if name != "gravity")]
)
def test_beds_of_dice_are_free_of_overlap_and_rest(method):
    poured, shaken = measure_beds(method, "cube", count=100)
    assert (poured.shaken, shaken.shaken) == (False, True)
    for bed in (poured, shaken):
        assert bed.apart
        assert bed.resting >= 0.95
        assert 0.48 < bed.bulk < 0.68
    assert shaken.bulk > poured.bulk


@pytest.mark.slow
def test_beds_are_written_beside_what_is_published(tmp_path):
    beds = [
        Bed(method, solid, shaken, 1.0, 0.5, True, 0.97)
        for method in METHODS
        for solid in PUBLISHED
        for shaken in (False, True)
    ]
    table, figure = write_beds(beds, tmp_path)
    rows = table.read_text().splitlines()
    assert len(rows) == 31
    assert rows[1].startswith("gravity,tetrahedron,false,0.5,1.0,0.5000,true,0.970,0.51,")
    assert figure.read_text().count("<svg") == 1
