"""The ranging radio: it samples at its rate, and sends each sample as one of three messages.
Scripted events can mute it.

The messages contain centimeters, millimeters or meters as a float, with the time of the
measurement.
"""

import math
from collections.abc import Callable
from functools import partial
from random import Random

from pymavlink.dialects.v20 import all as mavlink

from .agenda import Agenda
from .config import Ranging, VehicleConfig
from .flight import Flight
from .links import Message
from .sensor import DopplerSensor, RangeSensor, Sample

SECOND = 1_000_000
UNKNOWN_U32 = 4_294_967_295
UNKNOWN_COVARIANCE = 255
UNKNOWN_LATLON = 2_147_483_647
MOST_CM = 65_535
RADAR = 3


class RangingRadio:
    """The ranging radio. It sends messages by `send`. A radio on the autopilot's own rangefinder
    port passes its samples to `driver`."""

    def __init__(
        self, config: VehicleConfig, agenda: Agenda, flight: Flight,
        send: Callable[[Message], None], driver: Callable[[Sample], None],
    ) -> None:  # fmt: skip
        self._config = config.ranging
        self._agenda = agenda
        self._flight = flight
        self._send = send
        self._driver = driver
        self._sensor = RangeSensor(config.ranging, config.seed)
        self._doppler = DopplerSensor(config.ranging, config.seed)
        self.muted = False
        self.frozen = False
        self._held: Sample | None = None
        self._nodes_noise = Random(f"{config.seed}:nodes")
        self._node_sequence = 0
        if self._config.rate_hz > 0:
            agenda.every(("range",), round(SECOND / self._config.rate_hz), 0, self._measure)
        if self._config.via == "forwarded":
            agenda.every(("radio heartbeat",), SECOND, SECOND // 2, self._heartbeat)

    def _measure(self) -> None:
        now = self._flight.now
        sample = self._sensor.measure(self._flight.slant_range(), now)
        rate = (
            self._doppler.measure(self._flight.slant_rate())
            if self._config.rate_name is not None
            else 0.0
        )
        if sample is None or self.muted:
            return
        if self.frozen and self._held is not None:
            sample = sample._replace(distance=self._held.distance, rate=self._held.rate)
        else:
            sample = self._held = sample._replace(rate=rate)
        latency = round(self._config.latency_s * SECOND)
        if latency == 0:
            self._report(sample)
        else:
            self._agenda.put(
                ("report", sample.taken_us), now + latency, partial(self._report, sample)
            )

    def _report(self, sample: Sample) -> None:
        if self._config.via == "autopilot":
            self._driver(sample)
        else:
            if self._config.rate_name is not None:
                self._send(named_rate(self._config, sample))
            self._send(MESSAGES[self._config.message](self._config, sample))

    def range_node(self, node: int, distance: float) -> None:
        """Send a range to another radio. Its only error is the white noise."""
        if self.muted or self._config.message != "ranging_beacon":
            return
        reading = distance + self._nodes_noise.gauss(0.0, self._config.noise_m)
        self._node_sequence = (self._node_sequence + 1) % 256
        sample = Sample(self._flight.now, max(reading, 0.001), self._node_sequence)
        self._send(ranging_beacon(self._config.model_copy(update={"beacon_id": node}), sample))

    def _heartbeat(self) -> None:
        if not self.muted:
            kind = mavlink.MAV_TYPE_ONBOARD_CONTROLLER
            no_autopilot = mavlink.MAV_AUTOPILOT_INVALID
            self._send(mavlink.MAVLink_heartbeat_message(kind, no_autopilot, 0, 0, 4, 3))


def centimeters(meters: float) -> int:
    """Return a distance as in DISTANCE_SENSOR: whole centimeters, at most 655.35 m."""
    return min(MOST_CM, round(meters * 100))


def distance_sensor(config: Ranging, sample: Sample) -> Message:
    most = centimeters(config.max_range_m)
    distance = centimeters(sample.distance)
    about = RADAR, config.sensor_id, config.orientation, _covariance(config)
    return mavlink.MAVLink_distance_sensor_message(
        _stamp_ms(config, sample), 1, most, distance, *about
    )


def ranging_beacon(config: Ranging, sample: Sample) -> Message:
    accuracy = max(1, round(config.noise_m * 1000)) if config.report_accuracy else UNKNOWN_U32
    distance = min(UNKNOWN_U32 - 1, round(sample.distance * 1000))
    beacon = UNKNOWN_LATLON, UNKNOWN_LATLON, math.nan, 0, UNKNOWN_U32, UNKNOWN_U32, 0
    return mavlink.MAVLink_ranging_beacon_message(
        _stamp_us(config, sample),
        0,
        0,
        config.beacon_id,
        distance,
        *beacon,
        accuracy,
        sample.sequence,
        0,
    )


def named_value(config: Ranging, sample: Sample) -> Message:
    return mavlink.MAVLink_named_value_float_message(
        _stamp_ms(config, sample), config.name.encode(), sample.distance
    )


def named_rate(config: Ranging, sample: Sample) -> Message:
    """Return a NAMED_VALUE_FLOAT with the range rate, named `config.rate_name`. Its timestamp
    equals the timestamp of the range that is sent next."""
    rate = sample.rate if config.rate_sign == "opening" else -sample.rate
    name = config.rate_name or ""
    return mavlink.MAVLink_named_value_float_message(_stamp_ms(config, sample), name.encode(), rate)


def _stamp_ms(config: Ranging, sample: Sample) -> int:
    return _stamp_us(config, sample) // 1000 & 0xFFFFFFFF


def _stamp_us(config: Ranging, sample: Sample) -> int:
    """Return the timestamp of the radio's own clock, us. This clock may be ahead of other
    clocks."""
    return sample.taken_us + round(config.clock_offset_s * 1e6)


def _covariance(config: Ranging) -> int:
    """Return the variance in cm^2 if it is configured and fits the byte (noise up to 15.9 cm), else
    "unknown"."""
    variance = max(1, round((config.noise_m * 100) ** 2))
    return (
        variance if config.report_accuracy and variance < UNKNOWN_COVARIANCE else UNKNOWN_COVARIANCE
    )


MESSAGES = {
    "distance_sensor": distance_sensor,
    "ranging_beacon": ranging_beacon,
    "named_value_float": named_value,
}
