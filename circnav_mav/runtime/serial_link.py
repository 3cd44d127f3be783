"""A serial line, which may be unplugged and plugged in again."""

import os
import termios
from collections import Counter
from collections.abc import Hashable
from contextlib import suppress
from typing import Any

from circnav_mav.runtime.endpoint import MOST_BYTES, Endpoint, LinkError, explain

RETRY = 1.0
"""Time between two attempts to open it again, s."""
LOST = (OSError, ValueError, termios.error)
"""What a serial device raises that is vanishing. pyserial's own error is an OSError; it passes on that of the terminal,
which is none, where the device goes while it is being opened."""


class SerialLink:
    """A serial line through pyserial; reopened once a second after the device has vanished."""

    def __init__(self, text: str, endpoint: Endpoint) -> None:
        self.troubles: Counter[str] = Counter()
        self._endpoint = endpoint
        self._retry_at = float("-inf")
        try:
            import serial
        except ImportError:
            raise LinkError(f"endpoint {text}: needs the package pyserial: pip install pyserial") from None
        self._serial = serial
        try:
            self._port: Any = self._open()
        except LOST as error:
            raise LinkError(f"endpoint {text}: {explain(error)}") from None

    def fileno(self) -> int | None:
        """File descriptor to wait on, None while the device is gone."""
        return int(self._port.fileno()) if self._port else None

    def receive(self, now: float) -> list[tuple[bytes, Hashable]]:
        """The bytes that have come in."""
        if self._port is None:
            self._reopen(now)
            return []
        try:
            data = self._port.read(MOST_BYTES)
        except LOST as error:
            self.troubles[explain(error)] += 1
            self.close()
            self._port, self._retry_at = None, now + RETRY
            return []
        return [(data, self._endpoint.host)] if data else []

    def send(self, data: bytes, to: Hashable) -> None:
        """Send; a full buffer loses the bytes rather than delay the loop."""
        if self._port is None:
            return
        try:
            os.write(self._port.fileno(), data)
        except LOST as error:
            self.troubles[explain(error)] += 1

    def close(self) -> None:
        """Close the device; one that has vanished may refuse that, too."""
        if self._port is not None:
            with suppress(*LOST):
                self._port.close()

    def _open(self) -> Any:
        return self._serial.Serial(self._endpoint.host, self._endpoint.port, timeout=0, write_timeout=0)

    def _reopen(self, now: float) -> None:
        if now < self._retry_at:
            return
        self._retry_at = now + RETRY
        try:
            self._port = self._open()
        except LOST:
            self._port = None
