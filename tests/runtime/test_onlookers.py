"""Whoever is shown a flight has no part in it."""

from circnav_mav.runtime.onlookers import Onlookers
from circnav_mav.runtime.recorder import Turn


def test_one_that_fails_is_shown_no_more_and_the_others_go_on():
    seen, tries = [], []

    def breaks(newest, turn):
        tries.append(turn.time)
        if turn.time > 1.0:
            raise ValueError("Out of range float values are not JSON compliant")

    onlookers = Onlookers({"live page": breaks, "display": lambda newest, turn: seen.append(turn.time)})
    for moment in (1.0, 2.0, 3.0):
        onlookers.show(None, Turn(moment))
    assert seen == [1.0, 2.0, 3.0]
    assert tries == [1.0, 2.0]
    assert onlookers.problems == [
        "live page: stopped at 2.0 s: ValueError('Out of range float values are not JSON compliant')"
    ]
