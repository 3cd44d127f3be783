"""The rows of the benchmark and what `auto` has to reach in them."""

from math import radians

from circnav_mav.experiments.batch.flight import Circle, Situation
from circnav_mav.experiments.batch.sensors import LORA, UWB, ImuNoise, Ranging, RateNoise

V = Circle().speed
LAST = 100.0
"""The circle is judged over so many seconds at the end of a flight."""


SITUATIONS = {
    one.name: one
    for one in (
        Situation("calm", 0.12),
        Situation("wind .20 V", 0.25, wind=0.20 * V),
        Situation("wind .33 V", 0.35, wind=0.33 * V),
        Situation("wind .53 V", 0.60, wind=0.53 * V),
        Situation("target .2 V", 0.30, target=3.0),
        Situation("target .2 V, wind .2 V", 0.40, target=3.0, wind=0.20 * V),
        Situation("target turns", target=3.0, target_turn=0.05),
        Situation("wind .33 V turns 90 deg in 10 s", 0.4, wind=0.33 * V, veer=radians(90)),
        Situation("target stops and goes", 0.4, target=3.0, stands=30.0),
        Situation("target accelerates", target=3.0, target_walk=0.3),
        Situation("gusts 1.5, wind .33 V", 1.0, wind=5.0, gust=1.5),
        Situation("the same with accelerations", wind=5.0, gust=1.5, imu=ImuNoise()),
        Situation("accelerations, rate .3", wind=5.0, gust=1.5, imu=ImuNoise(), rates=RateNoise(0.3)),
        Situation("accelerations, rate .1", wind=5.0, gust=1.5, imu=ImuNoise(), rates=RateNoise(0.1)),
        Situation("gusts with rate .1 alone", wind=5.0, gust=1.5, rates=RateNoise(0.1)),
        Situation("uwb, wind .2 V", 0.35, wind=0.20 * V, ranging=UWB),
        Situation("lora, wind .2 V", 2.0, wind=0.20 * V, ranging=LORA),
        Situation("50 % loss at 5 Hz", wind=0.20 * V, ranging=Ranging(every=4, loss=0.5)),
        Situation("outage 10 s a minute", wind=0.20 * V, ranging=Ranging(outage=10.0)),
        Situation("10 % outliers of 20 m", wind=0.20 * V, ranging=Ranging(outlier_share=0.1)),
        Situation("compass bias 10 deg", wind=0.20 * V, compass_bias=radians(10)),
        Situation("heading drift .1 deg/s", wind=0.20 * V, compass_drift=radians(0.1)),
        Situation("airspeed +-10 %", wind=0.20 * V, airspeed_error=0.10),
    )
}
