"""The ranging radio as a device: samples at its rate, reports by its way, can be muted."""

from collections.abc import Callable
from functools import partial

from pymavlink.dialects.v20 import all as mavlink

from sim.agenda import Agenda
from sim.config import VehicleConfig
from sim.flight import Flight
from sim.radio import MESSAGES
from sim.sensor import RangeSensor, Sample
from sim.wire import Message

SECOND = 1_000_000


class RangingRadio:
    """Its messages go to `send`, its samples to `driver` when it hangs on the autopilot's own rangefinder port."""

    def __init__(
        self,
        config: VehicleConfig,
        agenda: Agenda,
        flight: Flight,
        send: Callable[[Message], None],
        driver: Callable[[Sample], None],
    ) -> None:
        self._config = config.ranging
        self._agenda = agenda
        self._flight = flight
        self._send = send
        self._driver = driver
        self._sensor = RangeSensor(config.ranging, config.seed)
        self.muted = False
        if self._config.rate_hz > 0:
            agenda.every(("range",), round(SECOND / self._config.rate_hz), 0, self._measure)
        if self._config.via == "forwarded":
            agenda.every(("radio heartbeat",), SECOND, SECOND // 2, self._heartbeat)

    def _measure(self) -> None:
        now = self._flight.now
        sample = self._sensor.measure(self._flight.slant_range(), now)
        if sample is None or self.muted:
            return
        latency = round(self._config.latency_s * SECOND)
        if latency == 0:
            self._report(sample)
        else:
            self._agenda.put(("report", sample.taken_us), now + latency, partial(self._report, sample))

    def _report(self, sample: Sample) -> None:
        if self._config.via == "autopilot":
            self._driver(sample)
        else:
            self._send(MESSAGES[self._config.message](self._config, sample))

    def _heartbeat(self) -> None:
        if not self.muted:
            self._send(mavlink.MAVLink_heartbeat_message(0, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))
