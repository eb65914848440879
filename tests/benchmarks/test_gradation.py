from benchmarks.grains.gradation import measured


def test_strata_are_as_far_from_the_distribution_on_every_seed_and_nearer_than_independent_draws():
    rows = {(name, way): row for name, way, _, *row in measured((100,), seeds=3)}
    for name in ("sieve", "lognormal", "rosin_rammler"):
        (_, near, apart, *_), (_, far, spread, *_) = rows[name, "strata"], rows[name, "independent"]
        assert near < far
        assert apart == 0.0 < spread
    # the largest strata of a sieve curve are the same grains
    assert rows["sieve", "strata"][4] == 0.0
