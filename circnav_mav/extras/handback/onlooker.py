"""Onlooker that runs the hand-back beside the survey of the target."""

from collections.abc import Mapping, Sequence
from typing import Any

from circnav_mav.extras.handback.companion import Companion
from circnav_mav.extras.handback.settings import handback_settings
from circnav_mav.extras.locate.onlooker import LocateOnlooker
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.onlookers import Onlooker, OnlookerSettings

COLUMNS = "time,latitude_deg,longitude_deg,sigma_m,by,answer,reported_off_m"


class HandBackOnlooker(Onlooker):
    """Onlooker that runs a `Companion`. If the survey fails, the hand-back continues with the last
    place of the target."""

    name = "hand-back"

    def __init__(self, companion: Companion) -> None:
        self.companion = companion

    @property
    def busy(self) -> bool:  # type: ignore[override]
        """True while positions are handed back or the vehicle's stream rates are not yet
        restored."""
        return self.companion.busy

    def on_step(
        self, newest: TickRecord | None, step: LoopStep, recording_problem: str | None
    ) -> Sequence[bytes]:
        """Process the frames of a step. Return the frames to send now: no frame if the pilot's
        frames were held back."""
        self.companion.called_off = self.called_off
        for link, source, received in step.received:
            self.companion.on_frames(link, source, received, step.time)
        return [] if step.held_back else self.companion.step(step.time)

    def facts(self, now: float) -> Mapping[str, str]:
        handback = self.companion.handback
        words = [handback.words] if handback.works and handback.words else []
        if self.companion.after_guidance:
            words.append(
                "goes on after guidance, until the autopilot has a position of its own, is"
                " disarmed, or Ctrl-C"
            )
        return {"hand-back": "; ".join(words)} if words else {}

    def alarms(self, now: float) -> Mapping[str, str]:
        handback = self.companion.handback
        failed = handback.words and not handback.works
        return {"hand_back": f"HAND-BACK: {handback.words}"} if failed else {}

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add the figures of the hand-back of positions to the summary. If positions were sent,
        return file name and text of handback.csv."""
        handback = self.companion.handback
        summary["handback"] = handback.plain()
        if not handback.given:
            return {}
        summary["notes"].append(
            f"  hand-back  {handback.sent} positions sent, {handback.accepted} accepted;"
            f" {handback.ended}"
        )
        rows = [
            f"{one.time:.2f},{one.latitude:.7f},{one.longitude:.7f},{one.sigma:.1f},{one.by},{one.answer},"
            + ("" if one.off is None else f"{one.off:.1f}")
            for one in handback.given
        ]
        return {"handback.csv": "\n".join([COLUMNS, *rows]) + "\n"}


def open_onlooker(given: OnlookerSettings) -> HandBackOnlooker | None:
    """Return the onlooker of the hand-back, or None if the mission does not enable it."""
    settings = handback_settings(given.mission)
    if settings is None:
        return None
    survey = next(one for one in given.others.attached if isinstance(one, LocateOnlooker))
    return HandBackOnlooker(Companion(settings, given.pilot, survey.locator, given.signing))
