"""`circnav preflight` as a process: what it prints and how it ends."""

import signal
import time

from tests.process import COPTER, PATIENCE, UNHURRIED, circnav


def preflight(*arguments: str) -> tuple[int, str, str]:
    process = circnav("preflight", *arguments)
    printed, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, printed, errors


def test_the_bundled_vehicle_passes_after_the_check_of_its_mission() -> None:
    code, printed, errors = preflight(COPTER, "--seconds", "3")
    assert (code, errors) == (0, ""), printed
    assert printed.index("turn rate") < printed.index("listening on sim") < printed.index("firmware")
    assert "PASS  ranging" in printed
    assert printed.splitlines()[-1].endswith("0 FAIL")


def test_a_failing_line_ends_with_4() -> None:
    code, printed, _ = preflight(COPTER, "--seconds", "4", "--set", "sim.ranging.rate_hz=0.0")
    assert code == 4
    assert "FAIL  ranging" in printed


def test_a_bad_mission_is_refused_before_anything_is_opened() -> None:
    code, printed, errors = preflight(COPTER, "--set", "orbit.raduis_m=3")
    assert (code, printed) == (2, "")
    assert "did you mean radius_m?" in errors
    code, printed, errors = preflight(COPTER, "--set", "orbit.radius_m=4.0")
    assert code == 2
    assert "FAIL  turn rate" in printed
    assert "listening" not in printed


def test_silence_ends_with_3_and_says_what_was_heard(port: int) -> None:
    code, printed, _ = preflight(COPTER, "--endpoint", f"udpin:127.0.0.1:{port}", "--set", "link.wait_s=1")
    assert code == 3
    assert "0 bytes heard" in printed


def test_too_short_a_time_to_listen_is_refused() -> None:
    assert preflight(COPTER, "--seconds", "0")[0] == 2


def test_a_signal_ends_it_with_130(port: int) -> None:
    process = circnav("preflight", COPTER, "--endpoint", f"udpin:127.0.0.1:{port}")
    assert process.stdout is not None
    for line in process.stdout:
        if "listening" in line:
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 130


def test_a_fast_simulator_passes_by_its_own_clock(port: int) -> None:
    vehicle = circnav("emulate", COPTER, "--endpoint", f"udpin:127.0.0.1:{port}", "--speed", "2")
    try:
        assert vehicle.stdout is not None
        vehicle.stdout.readline()
        endpoint = ("--endpoint", f"udpout:127.0.0.1:{port}")
        follows = ("--set", 'link.clock="autopilot"')
        code, printed, _ = preflight(COPTER, *endpoint, "--seconds", "8", *follows, *UNHURRIED)
        assert code == 0, printed
        assert "and the run follows it" in printed
    finally:
        vehicle.terminate()
        vehicle.communicate(timeout=PATIENCE)
