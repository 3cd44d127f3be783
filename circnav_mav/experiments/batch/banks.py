"""Many flights in several banks: a bank of this size stays in the processor's cache, which is four times as fast."""

from typing import Any

import numpy as np

from circnav_mav.guidance.estimators.multiple_model import BankSettings, DriftBank
from circnav_mav.guidance.estimators.relative_ekf import Felt

Array = Any
BLOCK = 250


class Banks:
    """As one `DriftBank` of B flights; flights do not know of each other, so the numbers are the same."""

    def __init__(self, settings: BankSettings, flights: int) -> None:
        self._slices = [slice(first, min(first + BLOCK, flights)) for first in range(0, flights, BLOCK)]
        self._banks = [DriftBank(settings, part.stop - part.start) for part in self._slices]

    def step(self, dt: Array, chord: Array, z: Array, sigma: Array, valid: Array, felt: Felt | None = None) -> None:
        """See `DriftBank.step`."""
        for part, bank in zip(self._slices, self._banks, strict=True):
            theirs = None if felt is None else felt.of(part)
            bank.step(dt[part], chord[:, part], z[part], sigma[part], valid[part], theirs)

    @property
    def mean(self) -> Array:
        return self._all("mean")

    @property
    def covariance(self) -> Array:
        return self._all("covariance")

    @property
    def stage(self) -> Array:
        return self._all("stage")

    @property
    def trusted(self) -> Array:
        return self._all("trusted")

    @property
    def favourite(self) -> Array:
        return self._all("favourite")

    def _all(self, name: str) -> Array:
        return np.concatenate([getattr(bank, name) for bank in self._banks], axis=-1)
