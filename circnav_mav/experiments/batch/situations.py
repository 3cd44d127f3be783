"""The rows of the benchmark and what `auto` has to reach in them."""

from dataclasses import dataclass
from math import radians

from circnav_mav.experiments.batch.flight import Circle, Situation
from circnav_mav.experiments.batch.sensors import LORA, UWB, ImuNoise, Ranging

V = Circle().speed
LAST = 100.0
"""The circle is judged over so many seconds at the end of a flight."""


@dataclass(frozen=True, slots=True)
class Row:
    """A situation with the median RMS radius error, m, that is required of `auto`; None where it is only reported."""

    situation: Situation
    required: float | None = None


SITUATIONS: dict[str, Row] = {
    row.situation.name: row
    for row in (
        Row(Situation("calm"), 0.12),
        Row(Situation("wind .20 V", wind=0.20 * V), 0.25),
        Row(Situation("wind .33 V", wind=0.33 * V), 0.35),
        Row(Situation("wind .53 V", wind=0.53 * V), 0.60),
        Row(Situation("target .2 V", target=3.0), 0.30),
        Row(Situation("target .2 V, wind .2 V", target=3.0, wind=0.20 * V), 0.40),
        Row(Situation("target turns", target=3.0, target_turn=0.05)),
        Row(Situation("wind .33 V turns 90 deg in 10 s", wind=0.33 * V, veer=radians(90)), 0.4),
        Row(Situation("target stops and goes", target=3.0, stands=30.0), 0.4),
        Row(Situation("target accelerates", target=3.0, target_walk=0.3)),
        Row(Situation("gusts 1.5, wind .33 V", wind=5.0, gust=1.5), 1.0),
        Row(Situation("the same with accelerations", wind=5.0, gust=1.5, imu=ImuNoise())),
        Row(Situation("uwb, wind .2 V", wind=0.20 * V, ranging=UWB), 0.35),
        Row(Situation("lora, wind .2 V", wind=0.20 * V, ranging=LORA), 2.0),
        Row(Situation("50 % loss at 5 Hz", wind=0.20 * V, ranging=Ranging(every=4, loss=0.5))),
        Row(Situation("outage 10 s a minute", wind=0.20 * V, ranging=Ranging(outage=10.0))),
        Row(Situation("10 % outliers of 20 m", wind=0.20 * V, ranging=Ranging(outlier_share=0.1))),
        Row(Situation("compass bias 10 deg", wind=0.20 * V, compass_bias=radians(10))),
        Row(Situation("heading drift .1 deg/s", wind=0.20 * V, compass_drift=radians(0.1))),
        Row(Situation("airspeed +-10 %", wind=0.20 * V, airspeed_error=0.10)),
    )
}
