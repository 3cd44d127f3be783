"""A vehicle that is copied flies on by itself."""

import copy

from sim.agenda import Agenda


class Counter:
    """Owns an agenda and counts what it is told."""

    def __init__(self) -> None:
        self.agenda = Agenda()
        self.count = 0
        self.agenda.every(("tick",), 10, 0, self.tick)

    def tick(self) -> None:
        self.count += 1


def test_repeated_appointment_of_a_copy_is_the_copys_own() -> None:
    first = Counter()
    first.agenda.take()()
    second = copy.deepcopy(first)
    for _ in range(3):
        second.agenda.take()()
    assert (first.count, second.count) == (1, 4)
    assert (first.agenda.next_due(), second.agenda.next_due()) == (10, 40)
