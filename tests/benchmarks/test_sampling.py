from benchmarks.grains.sampling import measured


def test_points_cover_more_than_those_of_open3d_and_keep_as_far_apart():
    rows = {row[:3]: row[3:] for row in measured((3000,))}
    assert {program for program, _, _ in rows} == {"voxgran", "Open3D"}
    for name in ("box", "itokawa_lp"):
        (own, covered, apart), (peer, holes, near) = (rows[program, name, 3000] for program in ("voxgran", "Open3D"))
        assert own > 0 < peer
        # 0.62 and 1 for a hexagonal arrangement
        assert 0.62 < covered < holes
        assert 0.98 * near < apart < 1
