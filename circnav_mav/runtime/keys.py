"""Signing key and its timestamp on disk."""

import os
from codecs import BOM_UTF8
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from circnav_mav.foreign import read_bytes
from circnav_mav.mav.signing import KEY_LENGTH, LATEST, SECOND, Signing
from circnav_mav.runtime.clock import unix_time

RESERVE = 10 * SECOND
"""Lead of the stored timestamp over the timestamp in use, in steps of 10 us: 10 s. After this
process is killed, the next process resumes with a later timestamp than any signed or accepted
frame. Its timestamps are then up to 10 s ahead of other clocks. Receivers tolerate this, because
they reject frames only from a difference of one minute on."""
MAX_KEY_FILE = 4096
"""Maximum size of a key file and of its timestamp file, bytes."""
TEXT = frozenset(range(32, 127))
REMEDY = "write 64 hex digits; of a passphrase: printf %s 'PASSPHRASE' | sha256sum | cut -c1-64"


class KeyFileError(Exception):
    """A key or timestamp file that cannot be used. The message is one line."""


def read_key(path: Path) -> bytes:
    """Return the 32-byte key of a file: raw bytes or 64 hex digits. Raises KeyFileError, for
    example if other users can read the file."""
    try:
        mode = path.stat().st_mode
        data = read_bytes(path, MAX_KEY_FILE).removeprefix(BOM_UTF8)  # added by Windows editors
    except OSError as error:
        raise KeyFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    if mode & 0o077:
        raise KeyFileError(
            f"{path}: other users can read this key (mode {mode & 0o777:o}): chmod 600 {path}"
        )
    key = data
    if TEXT.issuperset(data.strip()):  # 1 of 1e14 random keys is 32 printable bytes
        try:
            key = bytes.fromhex(data.decode("ascii"))
        except ValueError:
            raise KeyFileError(f"{path}: is not a key: {REMEDY}") from None
    if len(key) != KEY_LENGTH:
        raise KeyFileError(f"{path}: holds a key of {len(key)} bytes, not {KEY_LENGTH}: {REMEDY}")
    if not any(key):
        raise KeyFileError(f"{path}: is all zeros, with which autopilots disable signing: {REMEDY}")
    return key


def timestamp_path(key_file: Path) -> Path:
    """Return the path of the timestamp file of a key."""
    return key_file.with_name(f"{key_file.name}.timestamp")


class SigningTime:
    """Advances the signing timestamp with the wall clock and stores it across restarts. A separate
    thread writes, so that a slow disk never delays a tick. A disk error is reported in
    `problem`."""

    def __init__(
        self, signing: Signing, path: Path, clock: Callable[[], float] = unix_time
    ) -> None:
        """Start from the later of wall clock and stored timestamp. Raises KeyFileError if the file
        cannot be read or written."""
        self.problem: str | None = None
        self._signing = signing
        self._path = path
        self._clock = clock
        signing.resume(_stored(path))
        signing.advance(clock())
        self._reserved = signing.timestamp + RESERVE
        try:
            _store(path, self._reserved)
        except OSError as error:
            raise KeyFileError(f"{path}: cannot be written: {error.strerror or error}") from None
        self._writer = ThreadPoolExecutor(1, "signing time")

    def advance(self) -> None:
        """Advance the timestamp. Call in every step of the loop."""
        self._signing.advance(self._clock())
        if self._signing.timestamp > self._reserved - RESERVE // 2:
            self._reserved = self._signing.timestamp + RESERVE
            self._writer.submit(self._write, self._reserved)

    def close(self) -> None:
        """Store the timestamp in use without the reserve."""
        self._writer.submit(self._write, self._signing.timestamp)
        self._writer.shutdown()

    def _write(self, timestamp: int) -> None:
        try:
            _store(self._path, timestamp)
        except OSError as error:
            self.problem = f"{self._path}: cannot be written: {error.strerror or error}"


def _stored(path: Path) -> int:
    try:
        text = read_bytes(path, MAX_KEY_FILE).decode("ascii")
    except FileNotFoundError:
        return 0
    except (OSError, UnicodeDecodeError) as error:
        raise KeyFileError(
            f"{path}: cannot be read: {getattr(error, 'strerror', None) or 'not text'}"
        ) from None
    if not (text.strip().isdecimal() and int(text) <= LATEST):
        raise KeyFileError(
            f"{path}: is not a timestamp: delete it if the clock of this computer is right"
        )
    return int(text)


def _store(path: Path, timestamp: int) -> None:
    """Replace the file atomically."""
    fresh = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    with fresh.open("w", encoding="ascii") as file:
        file.write(f"{timestamp}\n")
        file.flush()
        os.fsync(file.fileno())
    os.replace(fresh, path)
