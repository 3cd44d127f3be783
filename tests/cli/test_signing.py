"""The command line with a signing key: what it refuses, what it tells, and what it keeps to itself."""

import json

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.cli.test_fly_refusals import PATIENTLY, Speaker, heartbeat
from tests.mav.test_signing import KEY, OTHER, peer

NOTHING_HEARD = 3


@pytest.fixture
def key(mission, text):
    """The mission's key, 64 hex digits beside it."""
    mission.write_text(f'{text}[signing]\nkey_file = "drone.key"\n')
    path = mission.with_name("drone.key")
    path.touch(0o600)
    path.write_text(KEY.hex())
    return path


def signed_heartbeat(key, timestamp):
    return bytes(mavlink.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3).pack(peer(key, timestamp=timestamp)))


@pytest.mark.parametrize("command", ["check", "fly", "preflight"])
def test_a_key_that_others_can_read_is_refused_before_anything_is_opened(circnav, mission, key, command):
    key.chmod(0o644)
    ran = circnav(command, mission)
    assert ran.code == 2
    assert ran.line == (
        f"circnav: {mission}: signing.key_file: {key}: others can read this key (mode 644): chmod 600 {key}"
    )


@pytest.mark.parametrize(
    ("frame", "reason"),
    [(heartbeat(), "unsigned"), (signed_heartbeat(OTHER, 2**47), "wrong_signature")],
    ids=["unsigned", "another key, stamped far in the future"],
)
def test_a_vehicle_that_is_not_believed_is_told_in_one_line_and_not_flown(
    circnav, mission, key, port, frame, reason, tmp_path
):
    with Speaker(port, frame):
        ran = circnav("fly", mission, "--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY, "--out", tmp_path / "out")
    assert ran.code == NOTHING_HEARD
    assert ran.err == ""
    (line,) = [line for line in ran.out.splitlines() if line.startswith("ABORTED")]
    assert "every frame heard is unsigned or wrongly signed" in line
    assert "check signing.key_file" in line
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert set(summary["frames_refused"]) == {reason}
    assert summary["setpoints_sent"] == 0


def test_the_key_gets_neither_into_the_run_folder_nor_onto_the_screen(circnav, mission, key, port, tmp_path):
    with Speaker(port, heartbeat()):
        ran = circnav("fly", mission, "--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY, "--out", tmp_path / "out")
    secrets = (KEY, KEY.hex().encode(), repr(KEY).encode())
    kept = b"".join(path.read_bytes() for path in (tmp_path / "out").iterdir()) + (ran.out + ran.err).encode()
    assert len(kept) > 1000
    assert not any(secret in kept for secret in secrets)
    assert str(key) in (tmp_path / "out" / "mission.toml").read_text()


def test_preflight_says_whom_it_does_not_believe(circnav, mission, key, port):
    with Speaker(port, heartbeat()):
        ran = circnav("preflight", mission, "--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY, "--seconds", "1")
    assert ran.code == NOTHING_HEARD
    assert "every frame heard is unsigned or wrongly signed" in ran.out
