"""The range rate that a radio measures: a NAMED_VALUE_FLOAT beside that of the range, of the same sender and clock."""

from collections.abc import Hashable
from math import isfinite

from circnav_mav.guidance.geometry import horizontal_rate
from circnav_mav.guidance.range_noise import NoiseCheck
from circnav_mav.guidance.rate_check import RateCheck
from circnav_mav.guidance.types import SAME_TIME, RangeSample, RateSample
from circnav_mav.mav.codec import Message
from circnav_mav.mav.ranging.interface import RangingSettings, as_text, boot_stamp
from circnav_mav.mav.ranging.reader import RangeReader

MOST = 3.0
"""A range rate of more than so many times V is none of this vehicle and its target."""


class RangeRateReader:
    """Range rates in, of which only those count that go with the ranges."""

    def __init__(self, settings: RangingSettings, ranging: RangeReader, noise: NoiseCheck, speed: float) -> None:
        """ranging: reads the ranges beside them. noise: of rates. speed: V, m/s."""
        self._settings, self._ranging, self._noise, self._most = settings, ranging, noise, MOST * speed
        self._check = RateCheck()
        self._stamp: float | None = None
        self._sigma = settings.rate_sigma

    @property
    def trouble(self) -> str:
        """Why measured rates do not count now, for people; empty where they do."""
        if self._noise.repeated:
            return f"frozen, the same number for {self._noise.repeated:.0f} s"
        return "" if self._check.trusted else self._check.why

    def carries(self, message: Message) -> bool:
        name = self._settings.rate_name
        return name is not None and message.get_type() == "NAMED_VALUE_FLOAT" and as_text(message.name) == name

    def range_taken(self, sample: RangeSample) -> None:
        """A range was taken, by which the rates are judged."""
        if self._ranging.restarted:
            self._check.reset()
            self._stamp = None
        if self._settings.rate_name is not None:
            self._check.add_range(sample.stamp, self._ranging.slant, sample.sigma, self._sigma)

    def read(
        self, message: Message, now: float, *, height: float | None = None, source: Hashable = None
    ) -> RateSample | None:
        """The sample of a message that carries a rate; None where it does not count. height: above the target, m."""
        settings, ranging = self._settings, self._ranging
        sender = (message.get_srcSystem(), message.get_srcComponent(), source)
        if sender != ranging.trusted or not isfinite(message.value) or abs(message.value) > self._most:
            return None
        carried = boot_stamp(message) if settings.sensor_stamps else None
        stamp = now if carried is None else ranging.clock.unwrapped(carried)
        time = now + min(ranging.clock.ahead(stamp, now), 0.0)
        if now - time > settings.max_age - SAME_TIME or (self._stamp is not None and stamp <= self._stamp):
            return None
        self._stamp = stamp
        rate = settings.rate_sign * message.value
        self._sigma = self._noise.corrected(stamp, rate, settings.rate_sigma, moving=ranging.moving)
        self._check.add_rate(stamp, rate)
        if self.trouble:
            return None
        flat = horizontal_rate(ranging.slant, rate - self._check.bias, self._sigma, height or 0.0)
        return None if flat is None else RateSample(stamp, time, *flat)
