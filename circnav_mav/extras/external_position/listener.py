"""Listener that runs the external position beside the locator of the target."""

from collections.abc import Mapping, Sequence
from typing import Any

from circnav_mav.extras.external_position.companion import Companion
from circnav_mav.extras.external_position.settings import external_position_settings
from circnav_mav.extras.locate.listener import LocateListener
from circnav_mav.pilot import TickRecord
from circnav_mav.pilot.loop_step import LoopStep
from circnav_mav.runtime.listeners import Listener, ListenerSettings

COLUMNS = "time,latitude_deg,longitude_deg,sigma_m,by,answer,reported_off_m"


class ExternalPositionListener(Listener):
    """Listener that runs a `Companion`. If the locator fails, the external position continues with
    the last place of the target."""

    name = "external position"

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
        external_position = self.companion.external_position
        words = (
            [external_position.words] if external_position.works and external_position.words else []
        )
        if self.companion.after_guidance:
            words.append(
                "goes on after guidance, until the autopilot has a position of its own, is"
                " disarmed, or Ctrl-C"
            )
        return {"external position": "; ".join(words)} if words else {}

    def alarms(self, now: float) -> Mapping[str, str]:
        external_position = self.companion.external_position
        failed = external_position.words and not external_position.works
        return (
            {"external_position": f"EXTERNAL POSITION: {external_position.words}"} if failed else {}
        )

    def finish(self, summary: dict[str, Any]) -> Mapping[str, str]:
        """Add the figures of the external position to the summary. If positions were
        sent, return file name and text of external_position.csv."""
        external_position = self.companion.external_position
        summary["external_position"] = external_position.plain()
        if not external_position.given:
            return {}
        summary["notes"].append(
            f"  external position  {external_position.sent} positions sent,"
            f" {external_position.accepted} accepted; {external_position.ended}"
        )
        rows = [
            f"{one.time:.2f},{one.latitude:.7f},{one.longitude:.7f},{one.sigma:.1f},{one.by},{one.answer},"
            + ("" if one.off is None else f"{one.off:.1f}")
            for one in external_position.given
        ]
        return {"external_position.csv": "\n".join([COLUMNS, *rows]) + "\n"}


def open_listener(given: ListenerSettings) -> ExternalPositionListener | None:
    """Return the listener of the external position, or None if the mission does not enable it."""
    settings = external_position_settings(given.mission)
    if settings is None:
        return None
    locator = next(one for one in given.others.attached if isinstance(one, LocateListener))
    return ExternalPositionListener(
        Companion(settings, given.pilot, locator.locator, given.signing)
    )
