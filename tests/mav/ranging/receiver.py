"""A reader of ranges, with messages that were packed and unpacked by pymavlink."""

from circnav_mav.mav.ranging.interface import RangingSettings
from circnav_mav.mav.ranging.reader import Accepted, RangeReader, Rejected
from tests.rig import Voice, distance

DISTANCE = RangingSettings(message="distance_sensor", sigma_m=0.5)


class Receiver:
    def __init__(self, settings=DISTANCE, height=None, **options):
        self.reader = RangeReader(settings, **options)
        self.sender = Voice(1, 1)
        self.answer = None
        self.height = height

    def receive(self, message, now=1.0, sender=None, source=None):
        message = (sender or self.sender).message(message)
        self.answer = self.reader.read(message, now, height=self.height, source=source)
        return self.answer.sample if isinstance(self.answer, Accepted) else None

    @property
    def restarted(self):
        """True if the newest message showed another clock."""
        return isinstance(self.answer, Accepted) and self.answer.restarted

    @property
    def rival(self):
        return self.answer.rival if isinstance(self.answer, Rejected) else None

    def distance(self, cm=10000, stamp=None, now=1.0, sender=None, source=None, **rest):
        """Receive a DISTANCE_SENSOR. stamp: ms; by default from a clock 500 s ahead of the local
        clock."""
        stamp = round(now * 1000) + 500_000 if stamp is None else stamp
        return self.receive(distance(cm, stamp, **rest), now, sender, source)

    @property
    def rejected(self):
        return dict(self.reader.rejected)
