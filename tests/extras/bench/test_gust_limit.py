"""The bound for flight in gusts."""

from tests.extras.bench.gust_limit import limit


def test_limit_is_above_kalman_filter_error():
    """Steady error of a Kalman filter that has the exact state except the gust, by an independent
    Riccati solution."""
    assert limit(1e-3)[0] > 0.197


def test_limit_with_perfect_ranges_matches_full_information():
    by_range, informed, _ = limit(1e-2, sigma=1e-4)
    assert by_range < 1.1 * informed


def test_ranges_of_half_meter_noise_double_the_error():
    by_range, informed, turn = limit(1e-2)
    assert turn < 0.21
    assert by_range > 2 * informed
