import pytest
from kit import references

from voxgran.bench.tradeoffs.dice import PUBLISHED, Bed, measure_bed, write_beds


def test_published_values_are_those_of_the_references():
    values = references("non_spherical")
    loose, shaken = values["platonic_dice_loose"], values["platonic_dice_shaken"]
    for solid, found in PUBLISHED.items():
        short = solid.removesuffix("hedron")
        assert found == (loose[short], shaken[short])


@pytest.mark.parametrize("method", ["digital", pytest.param("control_point", marks=pytest.mark.slow)])
def test_a_bed_of_dice_is_free_of_overlap(method):
    bed = measure_bed(method, "cube", 0.5, count=90)
    assert bed.apart
    assert not bed.shaken
    assert 0.42 < bed.bulk < 0.62


def test_beds_are_written_beside_what_is_published(tmp_path):
    beds = [
        Bed(method, solid, friction is None, friction or 0.0, 1.0, 0.5, True)
        for method in ("digital", "control_point")
        for solid in PUBLISHED
        for friction in (0.5, None)
    ]
    table, figure = write_beds(beds, tmp_path)
    rows = table.read_text().splitlines()
    assert len(rows) == 21
    assert rows[1].startswith('digital,"tetrahedron",false,0.5,1.0,0.5000,true,0.51,')
    assert figure.read_text().count("<svg") == 1
