"""Asking for a mode, and believing it only when the vehicle's own heartbeat shows it."""

from circnav_mav.mav.session import Session

PROOF = 3.0
"""Time, s, that an accepted request has to show in the vehicle's heartbeat (PX4 sends one a second)."""
TRIES = 3


class ModeRequest:
    """One mode that is wanted: asked for, asked for again, and given up with a reason."""

    def __init__(self) -> None:
        self._tries = 0
        self._due = float("-inf")
        self._dropped = 0

    def ask(self, session: Session, mode: int, now: float) -> str | None:
        """Keep asking; answers with the reason when there is no more use in it."""
        refusals = [result for result in session.take_mode_results() if not result.accepted]
        if refusals:
            said = f', the vehicle says "{session.texts[-1]}"' if session.texts else ""
            return f"refused: {refusals[0].said}{said}"
        if session.mode_requests_dropped > self._dropped and self._due > now:
            self._tries, self._due = self._tries - 1, now  # dropped before its answer: that was no try
        self._dropped = session.mode_requests_dropped
        if now < self._due or session.mode == mode:
            return None
        if self._tries == TRIES:
            said = f', the vehicle says "{session.texts[-1]}"' if session.texts else ""
            return f"acknowledged, but the vehicle stays in {session.mode_name}{said}"
        self._tries, self._due = self._tries + 1, now + PROOF
        session.commands.send(session.adapter.request_mode(mode))
        return None
