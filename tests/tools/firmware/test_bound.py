from tests.tools.firmware.bound import COSTS, best, lora_radius_error, squeezed


def test_radius_error_bound_grows_with_delay_and_disturbance() -> None:
    rms, turn = best(30.0, noise=0.5, delay=0.4)
    calmer, calmer_turn = best(300.0, noise=0.5, delay=0.4)
    assert calmer > rms and calmer_turn < turn
    assert best(30.0, noise=0.5, delay=1.0)[0] > rms > best(30.0, noise=0.15, delay=0.4)[0]
    assert best(30.0, noise=0.5, delay=0.4, case="Plane, turbulence 3")[0] > rms
    ours, our_turn = best(None, noise=0.5, delay=0.4)
    assert ours > min(
        best(cost, noise=0.5, delay=0.4)[0]
        for cost in COSTS
        if best(cost, noise=0.5, delay=0.4)[1] > our_turn
    )


def test_lora_radius_error_grows_with_random_walk_of_drift() -> None:
    assert lora_radius_error(1e-3) > lora_radius_error(0.0)


def test_least_lap_error_grows_with_lower_turn_limit() -> None:
    assert squeezed(0.23) < 1e-3 < squeezed(0.215) < squeezed(0.21)
