"""What is due when, in whole microseconds, so that every run of a seed is the same run."""

import heapq
from collections.abc import Callable
from functools import partial

NEVER = 1 << 62


class Agenda:
    """Named appointments; setting one again moves it, ties are kept in the order they were made."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, tuple[object, ...]]] = []  # due, order, key
        self._live: dict[tuple[object, ...], tuple[int, Callable[[], object]]] = {}
        self._order = 0

    def put(self, key: tuple[object, ...], due: int, action: Callable[[], object]) -> None:
        self._order += 1
        self._live[key] = (self._order, action)
        heapq.heappush(self._heap, (due, self._order, key))

    def every(self, key: tuple[object, ...], interval: int, first: int, action: Callable[[], object]) -> None:
        """An appointment that makes the next one."""
        self.put(key, first, partial(self._run, key, interval, first, action))

    def _run(self, key: tuple[object, ...], interval: int, due: int, action: Callable[[], object]) -> None:
        """A method, not a closure: a copied vehicle must run its own appointments."""
        self.put(key, due + interval, partial(self._run, key, interval, due + interval, action))
        action()

    def drop(self, key: tuple[object, ...]) -> None:
        self._live.pop(key, None)

    def drop_all(self, first: object) -> None:
        """Forget every appointment whose key starts with `first`."""
        for key in [k for k in self._live if k[0] == first]:
            del self._live[key]

    def next_due(self) -> int:
        """When the next appointment is, or NEVER."""
        while self._heap:
            due, order, key = self._heap[0]
            if key in self._live and self._live[key][0] == order:
                return due
            heapq.heappop(self._heap)
        return NEVER

    def take(self) -> Callable[[], object]:
        """The next appointment's action, taken off the agenda; only when next_due() is not NEVER."""
        _, _, key = heapq.heappop(self._heap)
        return self._live.pop(key)[1]
