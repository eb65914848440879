from benchmarks.images.distance import bench_images, measure_signed, measure_transforms


def test_images_hold_grains_pores_and_a_sphere():
    images = bench_images(48)
    assert 0.5 < images["grains"].mean() < 0.7
    assert (images["grains"] ^ images["pores"]).all()


def test_no_square_differs_from_scipy():
    rows = measure_transforms((32,))
    assert len(rows) == 3
    assert all(wrong == 0 and one > 0 and two > 0 and scipy > 0 for _, _, one, two, scipy, wrong in rows)


def test_errors_of_signed_distances():
    errors = {name: error for name, _, _, error in measure_signed((11,))}
    assert errors["mesh"] < 1e-4
    assert errors["fraction"] < 0.02
    assert errors["binary mask"] > 0.2
