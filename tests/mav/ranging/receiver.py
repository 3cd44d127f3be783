"""A reader of ranges, with messages that were packed and unpacked by pymavlink."""

from circnav_mav.mav.autopilots.interface import VehicleFacts
from circnav_mav.mav.autopilots.table import adapters
from circnav_mav.mav.identity import Identity, LinkSettings
from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.reader import RangeReader
from tests.rig import Voice, distance

DISTANCE = RangingSettings(message="distance_sensor", sigma_m=0.5)


def copter_identity():
    return Identity(
        LinkSettings(),
        adapters("ardupilot", "copter", VehicleFacts(speed=5.0, max_bank=0.7, drag=0.25)),
    )


class Receiver:
    def __init__(self, settings=DISTANCE, height=None, **options):
        self.identity = copter_identity()
        self.reader = RangeReader(settings, self.identity, **options)
        self.sender = Voice(1, 1)
        self.answer = None
        self.height = height

    def receive(self, message, now=1.0, sender=None, source=None):
        message = (sender or self.sender).message(message)
        self.answer = self.reader.read(message, now, height=self.height, source=source)
        return None if self.answer is None else self.answer.sample

    @property
    def restarted(self):
        """True if the newest message showed another clock."""
        return self.answer is not None and self.answer.restarted

    def distance(self, cm=10000, stamp=None, now=1.0, sender=None, source=None, **rest):
        """Receive a DISTANCE_SENSOR. stamp: ms; by default from a clock 500 s ahead of the local
        clock."""
        stamp = round(now * 1000) + 500_000 if stamp is None else stamp
        return self.receive(distance(cm, stamp, **rest), now, sender, source)

    @property
    def rejected(self):
        return dict(self.reader.rejected)
