"""Key files that are refused, in one line each; and a timestamp that outlives the process."""

import os
from pathlib import Path

import pytest

from circnav_mav.mav.signing import EPOCH, MINUTE, SECOND, Signing
from circnav_mav.runtime.keys import RESERVE, KeyFileError, SigningTime, read_key

KEY = bytes(range(200, 232))
UNIX = EPOCH + 370_000_000.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "drone.key"


def written(path: Path, data: bytes, mode: int = 0o600) -> Path:
    path.write_bytes(data)
    path.chmod(mode)
    return path


class Clock:
    """A wall clock that somebody sets."""

    def __init__(self, unix: float) -> None:
        self.unix = unix

    def __call__(self) -> float:
        return self.unix


# --- the key ---


@pytest.mark.parametrize(
    "data",
    [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n", b" " + KEY.hex().encode() + b"\r\n"],
    ids=["raw", "hex", "hex line", "hex with blanks"],
)
def test_a_key_is_32_bytes_or_64_hex_digits(path: Path, data: bytes) -> None:
    assert read_key(written(path, data)) == KEY


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "holds a key of 0 bytes, not 32"),
        (b"open sesame\n", "holds text that is no key"),
        (b"a pass phrase of 32 characters..", "holds text that is no key"),
        (KEY.hex().encode()[:-2], "holds a key of 31 bytes, not 32"),
        (KEY + KEY[:8], "holds a key of 40 bytes, not 32"),
        (bytes(32), "is all zeros"),
        (b"0" * 64, "is all zeros"),
    ],
)
def test_what_is_no_key_is_refused_in_one_line_with_the_remedy(path: Path, data: bytes, told: str) -> None:
    with pytest.raises(KeyFileError) as refused:
        read_key(written(path, data))
    line = str(refused.value)
    assert line.startswith(f"{path}: ")
    assert told in line
    assert "sha256sum" in line
    assert "\n" not in line


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644, 0o777])
def test_a_key_that_others_can_read_or_change_is_refused(path: Path, mode: int) -> None:
    with pytest.raises(KeyFileError, match=f"others can read this key .*: chmod 600 {path}$"):
        read_key(written(path, KEY, mode))


def test_a_key_that_is_not_there_is_refused(path: Path) -> None:
    with pytest.raises(KeyFileError, match="No such file"):
        read_key(path)


def test_a_folder_or_a_pipe_is_no_key(path: Path, tmp_path: Path) -> None:
    os.mkfifo(path, 0o600)
    for wrong in (path, tmp_path):
        with pytest.raises(KeyFileError, match="is not a file"):
            read_key(wrong)


# --- its time ---


def test_the_first_timestamp_is_that_of_the_clock(path: Path) -> None:
    signing = Signing(KEY)
    SigningTime(signing, path, Clock(UNIX)).close()
    assert signing.timestamp == 370_000_000 * SECOND


def test_a_restart_goes_on_where_the_last_run_ended_though_the_clock_was_set_back(path: Path) -> None:
    first, clock = Signing(KEY), Clock(UNIX)
    kept = SigningTime(first, path, clock)
    clock.unix += 100.0
    kept.turn()
    kept.close()
    again = Signing(KEY)
    SigningTime(again, path, Clock(0.0)).close()
    assert again.timestamp == first.timestamp == (370_000_000 + 100) * SECOND


@pytest.mark.parametrize("seconds", [0.0, 3.0, 9.9, 61.7])
def test_a_killed_process_signs_nothing_again(path: Path, seconds: float) -> None:
    """It never comes to close the file; the clock has gone back meanwhile."""
    killed, clock = Signing(KEY), Clock(UNIX)
    kept = SigningTime(killed, path, clock)
    for step in range(int(seconds * 20) + 1):
        clock.unix = UNIX + step / 20
        kept.turn()
    wait_for_the_writer(kept, path)
    again = Signing(KEY)
    SigningTime(again, path, Clock(UNIX - 3600)).close()
    assert killed.timestamp < again.timestamp <= killed.timestamp + RESERVE
    assert RESERVE < MINUTE / 2, "ahead of the others' clocks by less than what they refuse"


def test_the_file_is_written_seldom(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writes = []
    monkeypatch.setattr("circnav_mav.runtime.keys._store", lambda path, timestamp: writes.append(timestamp))
    clock = Clock(UNIX)
    kept = SigningTime(Signing(KEY), path, clock)
    for step in range(20 * 60):
        clock.unix = UNIX + step / 20
        kept.turn()
    kept.close()
    assert len(writes) <= 2 + 60 / 5
    assert writes == sorted(writes[:-1]) + writes[-1:]


def test_a_clock_that_is_set_forth_is_followed_and_one_set_back_is_not(path: Path) -> None:
    signing, clock = Signing(KEY), Clock(UNIX)
    kept = SigningTime(signing, path, clock)
    seen = []
    for jump in (0.0, 3600.0, -7200.0, 1.0):
        clock.unix += jump
        kept.turn()
        seen.append(signing.timestamp)
    kept.close()
    assert seen == [370_000_000 * SECOND, *[370_003_600 * SECOND] * 3]


@pytest.mark.parametrize("text", ["", "soon", "-5", "1.5", str(2**48), 5000 * "9", "\xff"])
def test_a_damaged_timestamp_is_refused_in_one_line(path: Path, text: str) -> None:
    path.write_text(text, encoding="latin-1")
    with pytest.raises(KeyFileError, match=f"^{path}: "):
        SigningTime(Signing(KEY), path, Clock(UNIX))


def test_a_folder_that_cannot_be_written_is_refused_before_the_flight(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match="cannot be written"):
        SigningTime(Signing(KEY), tmp_path / "gone" / "drone.key.timestamp", Clock(UNIX))


def test_a_disk_that_fails_in_flight_is_noted_and_stops_nothing(path: Path) -> None:
    signing, clock = Signing(KEY), Clock(UNIX)
    kept = SigningTime(signing, path, clock)
    path.unlink()
    path.mkdir()
    clock.unix += 60
    kept.turn()
    kept.close()
    assert kept.problem is not None
    assert "cannot be written" in kept.problem
    assert signing.timestamp == 370_000_060 * SECOND


def wait_for_the_writer(kept: SigningTime, path: Path) -> None:
    """What was asked for is on the disk; nothing more is asked for."""
    kept._writer.shutdown()
