"""Schedule of actions in whole microseconds, so that equal seeds give equal runs."""

import heapq
from collections.abc import Callable
from functools import partial

NEVER = 1 << 62


class Agenda:
    """Actions by key and time. `put` replaces the action of a key. Actions due at one time run in
    order of `put`."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, tuple[object, ...]]] = []  # due, order, key
        self._live: dict[tuple[object, ...], tuple[int, Callable[[], object]]] = {}
        self._order = 0

    def put(self, key: tuple[object, ...], due: int, action: Callable[[], object]) -> None:
        self._order += 1
        self._live[key] = (self._order, action)
        heapq.heappush(self._heap, (due, self._order, key))

    def every(
        self, key: tuple[object, ...], interval: int, first: int, action: Callable[[], object]
    ) -> None:
        """Run an action at `first` and then at every interval."""
        self.put(key, first, partial(self._run, key, interval, first, action))

    def _run(
        self, key: tuple[object, ...], interval: int, due: int, action: Callable[[], object]
    ) -> None:
        """Run a repeated action. This is a method, not a closure, because a copied vehicle must run
        its own actions."""
        self.put(key, due + interval, partial(self._run, key, interval, due + interval, action))
        action()

    def drop(self, key: tuple[object, ...]) -> None:
        self._live.pop(key, None)

    def drop_all(self, first: object) -> None:
        """Remove every action with a key that starts with `first`."""
        for key in [k for k in self._live if k[0] == first]:
            del self._live[key]

    def next_due(self) -> int:
        """Return the time of the next action, or NEVER."""
        # An action that was moved or dropped stays in the heap. It is recognized by its old order
        # number and discarded when it reaches the top.
        while self._heap:
            due, order, key = self._heap[0]
            if key in self._live and self._live[key][0] == order:
                return due
            heapq.heappop(self._heap)
        return NEVER

    def take(self) -> Callable[[], object]:
        """Remove and return the next action. Call only if next_due() is not NEVER."""
        _, _, key = heapq.heappop(self._heap)
        return self._live.pop(key)[1]
