"""Situations of the benchmark: wind, motion of the target, noise of radios and autopilots, and the
largest radius error allowed for the law `auto`."""

from dataclasses import dataclass, field
from math import hypot, radians

from circnav_mav.guidance.types import Direction, Orbit

ORBIT = Orbit(100.0, Direction.COUNTERCLOCKWISE, 15.0, radians(20.0))
"""Circle of config/quickstart.toml, flown in both directions."""
TURN_LAG = 0.4
"""Turn lag of config/quickstart.toml, s."""
V = ORBIT.speed
LAST = 100.0
"""Length of the evaluated last part of a flight, s."""


@dataclass(frozen=True, slots=True)
class Ranging:
    """Errors of a radio.

    white: standard deviation of white noise, m.
    drifting: standard deviation of a Gauss-Markov error, m.
    drift_time: correlation time of this error, s.
    loss: fraction of lost samples.
    outlier_share: fraction of samples with an error of up to ±outlier.
    outlier: largest error of an outlier, m.
    near_bias: bias at zero range, m. It falls linearly to 0 at the range `near`.
    near: range from which `near_bias` does not act, m.
    outage: time without samples in every minute, s.
    every: simulation steps per sample.
    """

    white: float = 0.5
    drifting: float = 0.0
    drift_time: float = 2.0
    loss: float = 0.0
    outlier_share: float = 0.0
    outlier: float = 20.0
    near_bias: float = 0.0
    near: float = 50.0
    outage: float = 0.0
    every: int = 1

    @property
    def sigma(self) -> float:
        """Standard deviation of white and drifting error together, m."""
        return hypot(self.white, self.drifting)


UWB = Ranging(white=0.02, drifting=0.15, drift_time=3.0)
LORA = Ranging(white=1.0, drifting=2.0, drift_time=5.0, every=2, loss=0.1, near_bias=3.0)


@dataclass(frozen=True, slots=True)
class RateNoise:
    """Standard deviations of measured range rates, m/s.

    white: noise, independent from sample to sample.
    bias: slowly varying bias, from the frequency offset of the carrier.
    bias_time: correlation time of the bias, s.
    """

    white: float = 0.3
    bias: float = 0.0
    bias_time: float = 60.0

    @property
    def sigma(self) -> float:
        """Standard deviation of white noise and bias together, m/s."""
        return hypot(self.white, self.bias)


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Standard deviations of an autopilot's reports of its own motion, independent from step to
    step. The defaults are those of real autopilots in calm air.

    heading: rad.
    turn_rate: rad/s.
    airspeed: m/s.
    """

    heading: float = 0.02
    turn_rate: float = 0.01
    airspeed: float = 0.3


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """Standard deviations of measured accelerations, m/s^2.

    white: noise, independent from step to step.
    bias: constant in a flight, forward and to the left. Includes the effect of the attitude error
        on the compensation of gravity.
    """

    white: float = 0.2
    bias: float = 0.1


@dataclass(frozen=True, slots=True)
class Situation:
    """One row of the benchmark. The directions of wind and target motion are random, and so are the
    signs of turns and biases.

    required: largest median RMS radius error of `auto`, m; None: no requirement.
    wind: steady wind, m/s.
    gust: standard deviation of each component of a Gauss-Markov process, m/s.
    target: speed of the target, m/s.
    target_turn: turn rate of the target's course, rad/s.
    target_walk: random walk of the target's velocity, m/s per sqrt(s). The speed is limited to the
        initial speed.
    veer: angle by which the wind direction changes in 10 s, once in 50 s, rad.
    stands: the target moves for this time, then stops for this time, in turn, s; 0: never stops.
    compass_bias: rad.
    compass_drift: rad/s.
    airspeed_error: measured over true airspeed, minus 1.
    imu: noise of measured accelerations; None: not measured.
    start: bounds of the initial range, m, uniform.
    duration: s.
    dt: step, s.
    """

    name: str
    required: float | None = None
    wind: float = 0.0
    gust: float = 0.0
    target: float = 0.0
    target_turn: float = 0.0
    target_walk: float = 0.0
    veer: float = 0.0
    stands: float = 0.0
    ranging: Ranging = field(default_factory=Ranging)
    rates: RateNoise | None = None
    compass_bias: float = 0.0
    compass_drift: float = 0.0
    noise: MotionNoise = field(default_factory=MotionNoise)
    airspeed_error: float = 0.0
    imu: ImuNoise | None = None
    start: tuple[float, float] = (10.0, 600.0)
    duration: float = 400.0
    dt: float = 0.05


SITUATIONS = {
    one.name: one
    for one in (
        Situation("calm", 0.12),
        Situation("wind 0.20 V", 0.25, wind=0.20 * V),
        Situation("wind 0.33 V", 0.35, wind=0.33 * V),
        Situation("wind 0.53 V", 0.60, wind=0.53 * V),
        Situation("target 0.2 V", 0.30, target=3.0),
        Situation("target 0.2 V, wind 0.2 V", 0.40, target=3.0, wind=0.20 * V),
        Situation("target turns", target=3.0, target_turn=0.05),
        Situation("wind 0.33 V turns 90 deg in 10 s", 0.4, wind=0.33 * V, veer=radians(90)),
        Situation(
            "wind 0.33 V turns, with accelerations",
            0.4,
            wind=0.33 * V,
            veer=radians(90),
            imu=ImuNoise(),
        ),
        Situation("target stops and goes", 0.4, target=3.0, stands=30.0),
        Situation("target accelerates", target=3.0, target_walk=0.3),
        Situation("gusts 1.5, wind 0.33 V", 1.0, wind=5.0, gust=1.5),
        Situation("gusts, with accelerations", wind=5.0, gust=1.5, imu=ImuNoise()),
        Situation(
            "accelerations, rate 0.3", wind=5.0, gust=1.5, imu=ImuNoise(), rates=RateNoise(0.3)
        ),
        Situation(
            "accelerations, rate 0.1", wind=5.0, gust=1.5, imu=ImuNoise(), rates=RateNoise(0.1)
        ),
        Situation("gusts, with range rates", wind=5.0, gust=1.5, rates=RateNoise(0.1)),
        Situation("uwb, wind 0.2 V", 0.35, wind=0.20 * V, ranging=UWB),
        Situation("lora, wind 0.2 V", 2.0, wind=0.20 * V, ranging=LORA),
        Situation("50 % loss at 5 Hz", wind=0.20 * V, ranging=Ranging(every=4, loss=0.5)),
        Situation("outage 10 s a minute", wind=0.20 * V, ranging=Ranging(outage=10.0)),
        Situation("10 % outliers of 20 m", wind=0.20 * V, ranging=Ranging(outlier_share=0.1)),
        Situation("compass bias 10 deg", wind=0.20 * V, compass_bias=radians(10)),
        Situation("heading drift 0.1 deg/s", wind=0.20 * V, compass_drift=radians(0.1)),
        Situation("airspeed +-10 %", wind=0.20 * V, airspeed_error=0.10),
    )
}
