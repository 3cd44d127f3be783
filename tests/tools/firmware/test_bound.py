from tests.tools.firmware.bound import COSTS, best, squeezed, told


def test_to_turn_less_or_later_or_by_worse_ranges_holds_the_circle_worse() -> None:
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


def test_a_drift_that_wanders_hides_the_radius() -> None:
    assert told(1e-3) > told(0.0)


def test_a_lap_is_as_true_as_its_turn_limit_lets_it() -> None:
    assert squeezed(0.23) < 1e-3 < squeezed(0.215) < squeezed(0.21)
