"""Whose the vehicle is: the operator always wins."""

from dataclasses import dataclass

from circnav_mav.mav.session import Session


@dataclass(frozen=True, slots=True)
class Takeover:
    """The vehicle was taken from us. what: for the air, as STATUSTEXT. reason: for the record."""

    what: str
    reason: str


class Authority:
    """A mode that is not ours, disarming or a reboot takes the vehicle from us; it is ours again only after it was seen
    outside the guided mode and then in it."""

    def __init__(self) -> None:
        self.consent = True
        """Whether the guided mode means that we may steer."""
        self.left_mode = False
        """Whether the guided mode has been left since."""
        self._departures = 0

    def watch(self, session: Session, *, ours: bool, rebooted: bool) -> Takeover | None:
        """What took the vehicle from us, if it was ours until now; also if it has come back since the last look."""
        departed, self._departures = session.told.departures > self._departures, session.told.departures
        outside = session.up and session.mode is not None and session.mode != session.adapter.guided_mode
        left_for = session.mode_name if outside else session.told.left_for if departed else None
        if left_for is not None:
            self.left_mode = True
        if self.left_mode and session.in_our_mode and not departed:
            self.consent, self.left_mode = True, False
        if not ours or not session.up or (session.in_our_mode and not rebooted and not departed):
            return None
        self.consent, self.left_mode = False, left_for is not None
        if rebooted or left_for is None:
            what = "autopilot rebooted" if rebooted else "vehicle disarmed"
            return Takeover(what, what)
        what = f"{session.adapter.mode_names[session.adapter.guided_mode]} left for {left_for}"
        return Takeover(what, f"{what}: operator or failsafe")
