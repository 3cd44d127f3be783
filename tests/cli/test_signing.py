"""The command line with a signing key: what it refuses, what it tells, and what it keeps to itself."""

import json

import pytest

from tests.cli.test_fly_refusals import PATIENTLY, heartbeat, speaking
from tests.mav.test_signing import KEY

pytestmark = pytest.mark.usefixtures("undrawn")
NOTHING_HEARD = 3


@pytest.fixture
def key(mission):
    """The mission's key, 64 hex digits beside it."""
    with mission.open("a") as file:
        file.write('[signing]\nkey_file = "drone.key"\n')
    path = mission.with_name("drone.key")
    path.touch(0o600)
    path.write_text(KEY.hex())
    return path


@pytest.fixture
def unsigned(circnav, mission, key, port):
    """How a command ends that hears unsigned heartbeats alone: unsigned("fly")."""

    def unsigned(command, *options):
        with speaking(port, heartbeat()):
            return circnav(command, mission, "--endpoint", f"udpin:127.0.0.1:{port}", *PATIENTLY, *options)

    return unsigned


def test_a_key_that_others_can_read_is_refused_before_anything_is_opened(circnav, mission, key):
    key.chmod(0o644)
    says = f"{key}: others can read this key (mode 644): chmod 600 {key}"
    assert circnav("fly", mission).refused == f"{mission}: signing.key_file: {says}"


def test_a_damaged_timestamp_is_refused(circnav, mission, key):
    key.with_name("drone.key.timestamp").write_text("yesterday")
    assert "drone.key.timestamp: is not a timestamp" in circnav("fly", mission).refused


def test_a_vehicle_that_is_not_believed_is_told_in_one_line_and_the_key_to_nobody(unsigned, key, tmp_path):
    ran = unsigned("fly", "--out", tmp_path / "out")
    assert (ran.code, ran.err) == (NOTHING_HEARD, "")
    (line,) = [line for line in ran.out.splitlines() if line.startswith("ABORTED")]
    assert "every frame heard is unsigned or wrongly signed" in line
    assert "check signing.key_file" in line
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (set(summary["frames_refused"]), summary["setpoints_sent"]) == ({"unsigned"}, 0)
    kept = b"".join(path.read_bytes() for path in (tmp_path / "out").iterdir()) + ran.out.encode()
    assert str(key).encode() in kept
    assert not any(secret in kept for secret in (KEY, KEY.hex().encode(), repr(KEY).encode()))


def test_preflight_says_whom_it_does_not_believe(unsigned):
    ran = unsigned("preflight", "--seconds", "1")
    assert ran.code == NOTHING_HEARD
    assert "every frame heard is unsigned or wrongly signed" in ran.out
