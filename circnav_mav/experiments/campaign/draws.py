"""The emulator's own random numbers, many flights at once: the generators of its ranging sensor and of its gusts.

The emulator draws from `random.Random("<seed>:ranging")` and `("<seed>:gusts")`; numpy's MT19937 continues the same
sequence from the same state. `Random.gauss` makes two normals of two uniforms, cosine first, and keeps the sine for
its next call.
"""

from collections.abc import Sequence
from random import Random
from typing import Any

import numpy as np

Array = Any
BLOCK = 64
"""Draws made at once: a call of numpy costs as much as some hundred numbers."""


class Uniforms:
    """Uniform numbers of B flights from streams named after their seeds, `width` of them at a time."""

    def __init__(self, seeds: Sequence[int], name: str, width: int) -> None:
        self._streams = [_stream(f"{seed}:{name}") for seed in seeds]
        self._width, self._at = width, BLOCK
        self._block = np.empty((BLOCK, width, len(seeds)))

    def first(self, count: int) -> Array:
        """The first numbers of each stream, (count, B); before any `next`."""
        return np.stack([stream.random_sample(count) for stream in self._streams], axis=1)

    def next(self) -> Array:
        """The next numbers of each stream, (width, B)."""
        if self._at == BLOCK:
            for flight, stream in enumerate(self._streams):
                self._block[:, :, flight] = stream.random_sample((BLOCK, self._width))
            self._at = 0
        self._at += 1
        return self._block[self._at - 1]


def gauss(turn: Array, size: Array) -> tuple[Array, Array]:
    """The two normals that `Random.gauss` makes of two uniforms, in its order."""
    radius = np.sqrt(-2.0 * np.log(1.0 - size))
    angle = 2 * np.pi * turn
    return np.cos(angle) * radius, np.sin(angle) * radius


def _stream(name: str) -> np.random.RandomState:
    state: tuple[int, ...] = Random(name).getstate()[1]
    stream = np.random.RandomState()
    stream.set_state({"bit_generator": "MT19937", "state": {"key": np.array(state[:-1], np.uint32), "pos": state[-1]}})
    return stream
