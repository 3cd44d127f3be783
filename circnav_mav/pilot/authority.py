"""Whose the vehicle is: the operator always wins."""

from dataclasses import dataclass

from circnav_mav.mav.session import Session

GIVEN_AFTER = 1.5
"""Time, s, for which the vehicle must have told nothing but the guided mode, from one word to a later one, before it is
given back: a switch may pass through that mode, and what was said before it was left may come late by another way,
between newer words."""


@dataclass(frozen=True, slots=True)
class Takeover:
    """The vehicle was taken from us. what: for the air, as STATUSTEXT. reason: for the record."""

    what: str
    reason: str


class Authority:
    """A mode that is not ours, disarming or a reboot takes the vehicle from us; it is ours again only after it was seen
    outside the guided mode and then, for a while, in it."""

    def __init__(self) -> None:
        self.consent = True
        """Whether the guided mode means that we may steer."""
        self.left_mode = False
        """Whether the guided mode has been left since."""
        self._departures = 0
        self._back_since: float | None = None

    def watch(self, session: Session, *, ours: bool, rebooted: bool) -> Takeover | None:
        """What took the vehicle from us, if it was ours until now; also if it has come back since the last look."""
        departed, self._departures = session.told.departures > self._departures, session.told.departures
        outside = session.up and session.mode is not None and session.mode != session.adapter.guided_mode
        left_for = session.mode_name if outside else session.told.left_for if departed else None
        if left_for is not None:
            self.left_mode = True
        if not session.in_our_mode or departed:
            self._back_since = None
        elif self.left_mode:
            heard_at = session.told.heard_at
            self._back_since = heard_at if self._back_since is None else self._back_since
            if self.consent or heard_at - self._back_since >= GIVEN_AFTER:
                self.consent, self.left_mode = True, False
        if not ours or not session.up or (session.in_our_mode and not rebooted and not departed):
            return None
        self.consent, self.left_mode = False, left_for is not None
        if rebooted or left_for is None:
            what = "autopilot rebooted" if rebooted else "vehicle disarmed"
            return Takeover(what, what)
        what = f"{session.adapter.guided_name} left for {left_for}"
        return Takeover(what, f"{what}: operator or failsafe")
