"""Key files that are refused, each in one line, and the signing timestamp, which a restart
continues."""

import os
from pathlib import Path

import pytest

from circnav_mav.mav.signing import EPOCH, MINUTE, SECOND, Refusal, Signing
from circnav_mav.runtime.keys import RESERVE, KeyFileError, SigningTime, read_key
from tests.flight.signed import voice
from tests.rig import distance, heartbeat

KEY = bytes(range(200, 232))
BEGAN = 370_000_000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "drone.key"


def written(path: Path, data: bytes, mode: int = 0o600) -> Path:
    path.write_bytes(data)
    path.chmod(mode)
    return path


# --- the key


@pytest.mark.parametrize(
    "data",
    [
        KEY,
        KEY.hex().encode(),
        KEY.hex().upper().encode() + b"\n",
        b" " + KEY.hex().encode() + b"\r\n",
        b"\xef\xbb\xbf" + KEY.hex().encode(),
    ],
    ids=["raw", "hex", "hex line", "hex with blanks", "hex of an editor on Windows"],
)
def test_key_file_has_32_bytes_or_64_hex_digits(path: Path, data: bytes) -> None:
    assert read_key(written(path, data)) == KEY


@pytest.mark.parametrize(
    ("data", "mode", "error", "remedy"),
    [
        (b"", 0o600, "holds a key of 0 bytes, not 32", "sha256sum"),
        (b"a pass phrase of 32 characters..", 0o600, "is not a key", "sha256sum"),
        (KEY.hex().encode()[:-2], 0o600, "holds a key of 31 bytes, not 32", "sha256sum"),
        (KEY + KEY[:8], 0o600, "holds a key of 40 bytes, not 32", "sha256sum"),
        (bytes(32), 0o600, "is all zeros", "sha256sum"),
        (b"0" * 64, 0o600, "is all zeros", "sha256sum"),
        *(
            (KEY, mode, "other users can read this key ", ": chmod 600 {path}")
            for mode in (0o640, 0o604, 0o620, 0o777)
        ),
    ],
)
def test_unsuitable_key_file_is_refused_with_remedy(path, data, mode, error, remedy):
    with pytest.raises(KeyFileError) as refused:
        read_key(written(path, data, mode))
    line = str(refused.value)
    assert line.startswith(f"{path}: {error}")
    assert remedy.format(path=path) in line
    assert "\n" not in line


def test_missing_key_folder_and_pipe_are_refused(path: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="No such file"):
        read_key(path)
    os.mkfifo(path, 0o600)
    for wrong in (path, tmp_path):
        with pytest.raises(KeyFileError, match=r"is not a regular file|Is a directory"):
            read_key(wrong)


# --- the signing timestamp


class Flight:
    """A flight that signs. The test sets its wall clock, s after BEGAN."""

    def __init__(self, path: Path, seconds: float = 0.0) -> None:
        self.seconds = seconds
        self.signing = Signing(KEY)
        self.kept = SigningTime(self.signing, path, lambda: EPOCH + BEGAN + self.seconds)

    def turn(self, seconds: float) -> None:
        self.seconds = seconds
        self.kept.advance()

    @property
    def signed(self) -> float:
        """Return the newest signed timestamp, s after BEGAN."""
        return self.signing.timestamp / SECOND - BEGAN


def test_signing_timestamp_continues_after_restart(path: Path) -> None:
    first = Flight(path)
    assert first.signed == 0.0
    first.turn(100.0)
    first.kept.close()
    again = Flight(path, -1e8)
    again.kept.close()
    assert again.signed == first.signed == 100.0


@pytest.mark.parametrize("seconds", [0.0, 9.9, 15.0, 61.7])
def test_killed_process_never_repeats_a_timestamp(path, seconds, monkeypatch):
    """The killed process does not close the timestamp file, and the wall clock is set back before
    the restart."""
    writes = []
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda *names: writes.append(names) or replace(*names))
    killed = Flight(path)
    for step in range(int(seconds * 20) + 1):
        killed.turn(step / 20)
    killed.kept._writer.shutdown()
    assert len(writes) <= 1 + seconds / 5
    again = Flight(path, -3600.0)
    assert killed.signing.timestamp < again.signing.timestamp <= killed.signing.timestamp + RESERVE
    assert RESERVE < MINUTE / 2


@pytest.mark.parametrize("ends", ["closed", "killed"])
@pytest.mark.parametrize("down", [0.0, 3.0, 50.0])
def test_frames_from_before_restart_are_rejected(path, ends, down):
    """Radio and vehicle send for 20 s. After a restart of circnav both are silent, and an attacker
    repeats all frames."""
    first = Flight(path)
    recorded = []
    radio = voice(KEY, component=192)
    vehicle = voice(KEY)
    for step in range(200):
        first.turn(step / 10)
        for engine, message in (
            (radio, distance(5000 + step % 2, 100 * step)),
            (vehicle, heartbeat()),
        ):
            engine.signing.timestamp = round((BEGAN + step / 10) * SECOND)
            recorded.append(bytes(message.pack(engine)))
            assert first.signing.check(recorded[-1]) is None
    first.kept.close() if ends == "closed" else first.kept._writer.shutdown()
    again = Flight(path, 20.0 + down)
    assert {again.signing.check(frame) for frame in recorded} == {Refusal.BEHIND}
    assert vehicle.decode(
        bytearray(again.signing.sign(bytes(heartbeat().pack(voice(None)))))
    ).get_signed()
    assert again.signing.check(bytes(heartbeat().pack(vehicle))) is None
    radio.signing.timestamp = round((BEGAN + 20.0 + max(down, RESERVE / SECOND)) * SECOND) + 1
    assert again.signing.check(bytes(distance(5000, 9).pack(radio))) is None
    assert {again.signing.check(frame) for frame in recorded} == {Refusal.REPEATED}


def test_signing_timestamp_follows_clock_only_forward(path: Path) -> None:
    flight = Flight(path)
    seen = []
    for seconds in (0.0, 3600.0, -3600.0, -3599.0):
        flight.turn(seconds)
        seen.append(flight.signed)
    assert seen == [0.0, 3600.0, 3600.0, 3600.0]


def test_damaged_timestamp_file_is_refused_in_one_line(path: Path) -> None:
    for text in ("", "soon", "-5", "1.5", str(2**48), 5000 * "9", "\xff"):
        path.write_text(text, encoding="latin-1")
        with pytest.raises(KeyFileError, match=f"^{path}: "):
            Flight(path)
    with pytest.raises(KeyFileError, match="cannot be written"):
        Flight(path.parent / "gone" / "drone.key.timestamp")


def test_failure_to_store_signing_timestamp_is_reported(path: Path) -> None:
    flight = Flight(path)
    path.unlink()
    path.mkdir()
    flight.turn(60.0)
    flight.kept.close()
    assert "cannot be written" in (flight.kept.problem or "")
    assert flight.signed == 60.0
