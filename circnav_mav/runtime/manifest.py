"""manifest.json: what a run folder says of itself. Written before the first turn of the loop and again at the end, so
that a run whose process was killed still opens; its `exit` is then null."""

import json
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from circnav_mav import __version__

LIBRARIES = ("pymavlink", "numpy", "filterpy")


def versions() -> dict[str, str | None]:
    """The versions of all that takes part in a flight."""
    found: dict[str, str | None] = {"circnav": __version__, "python": platform.python_version()}
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = None
    return found


class Manifest:
    """manifest.json of one run."""

    def __init__(self, folder: Path, *, mission: str, voice: str, epoch_us: int, seeds: dict[str, int]) -> None:
        """Raises OSError."""
        self._path = folder / "manifest.json"
        self._facts: dict[str, Any] = {
            "mission": mission,
            "voice": voice,
            "epoch_us": epoch_us,
            "seeds": seeds,
            "versions": versions(),
            "autopilot": None,
            "outcome": None,
            "reason": None,
            "exit": None,
        }
        self._write()

    def complete(self, *, autopilot: dict[str, Any] | None, outcome: str, reason: str, exit: int) -> None:
        """Add what is known at the end. Raises OSError."""
        self._facts |= {"autopilot": autopilot, "outcome": outcome, "reason": reason, "exit": exit}
        self._write()

    def _write(self) -> None:
        """In one move, so that there is a whole file at every moment."""
        fresh = self._path.with_suffix(".tmp")
        try:
            fresh.write_text(json.dumps(self._facts, indent=2) + "\n", encoding="utf-8")
            os.replace(fresh, self._path)
        except OSError:
            fresh.unlink(missing_ok=True)
            raise
