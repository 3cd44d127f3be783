"""The bound for flight in gusts."""

from tests.extras.bench.gust_limit import limit


def test_nobody_holds_the_circle_better_than_the_noise_lets_him_see_it():
    """Steady error of a Kalman filter that has the exact state except the gust, by an independent
    Riccati solution."""
    assert limit(1e-3)[0] > 0.197


def test_with_a_perfect_range_ranges_are_full_information():
    by_range, informed, _ = limit(1e-2, sigma=1e-4)
    assert by_range < 1.1 * informed


def test_within_the_turn_limit_ranges_of_half_a_metre_cost_more_than_twice_the_error():
    by_range, informed, turn = limit(1e-2)
    assert turn < 0.21
    assert by_range > 2 * informed
