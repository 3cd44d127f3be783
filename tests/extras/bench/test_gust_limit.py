"""Lower bound of the radius error in gusts."""

from tests.extras.bench.gust_limit import limit


def test_error_bound_in_gusts_exceeds_error_with_known_states():
    """Reference: steady error of a Kalman filter that knows all states except the gust, from an
    independent Riccati solution."""
    assert limit(1e-3)[0] > 0.197


def test_error_bound_with_perfect_ranges_equals_full_information():
    by_range, informed, _ = limit(1e-2, sigma=1e-4)
    assert by_range < 1.1 * informed


def test_range_noise_of_half_meter_doubles_error_bound():
    by_range, informed, turn = limit(1e-2)
    assert turn < 0.21
    assert by_range > 2 * informed
