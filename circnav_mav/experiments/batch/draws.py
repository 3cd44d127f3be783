"""Random numbers of B flights, from a stream for each: what a flight draws does not depend on who flies with it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

Array = Any
BLOCK = 64
"""Draws made at once: a call of numpy costs as much as some hundred numbers."""


class Draws:
    """So many normal and uniform numbers of every flight at a time, (normals + uniforms, B). One seed, one stream; part
    tells the streams of one seed apart."""

    def __init__(self, seeds: Sequence[Sequence[int]], part: int, normals: int, uniforms: int = 0) -> None:
        self._streams = [np.random.default_rng([*seed, part]) for seed in seeds]
        self._normals, self._uniforms, self._at = normals, uniforms, BLOCK
        self._block = np.empty((BLOCK, normals + uniforms, len(seeds)))

    def next(self) -> Array:
        """The next numbers."""
        if self._at == BLOCK:
            for flight, stream in enumerate(self._streams):
                self._block[:, : self._normals, flight] = stream.standard_normal((BLOCK, self._normals))
                self._block[:, self._normals :, flight] = stream.random((BLOCK, self._uniforms))
            self._at = 0
        self._at += 1
        return self._block[self._at - 1]
