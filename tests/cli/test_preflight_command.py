"""`circnav preflight`: what it prints and how it ends."""

import signal
import time

from tests.process import PATIENCE, UNHURRIED
from tests.process import circnav as process_of


def test_the_bundled_vehicle_passes_after_the_check_of_its_mission(circnav):
    printed = circnav("preflight", "copter", "--seconds", "3").done
    assert printed.index("turn rate") < printed.index("listening on sim") < printed.index("firmware")
    assert "PASS  ranging" in printed
    assert printed.splitlines()[-1].endswith("0 FAIL")


def test_a_failing_line_ends_with_4(circnav):
    ran = circnav("preflight", "copter", "--seconds", "4", "--set", "sim.ranging.rate_hz=0.0")
    assert ran.code == 4
    assert "FAIL  ranging" in ran.out


def test_silence_ends_with_3_and_says_what_was_heard(circnav, port):
    ran = circnav("preflight", "copter", "--endpoint", f"udpin:127.0.0.1:{port}", "--set", "link.wait_s=1")
    assert ran.code == 3
    assert "0 bytes heard" in ran.out


def test_a_signal_ends_it_with_130(port):
    with process_of("preflight", "copter", "--endpoint", f"udpin:127.0.0.1:{port}") as process:
        assert any("listening" in line for line in process.stdout)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE)
    assert process.returncode == 130


def test_a_fast_simulator_passes_by_its_own_clock(circnav, port):
    with process_of("emulate", "copter", "--endpoint", f"udpin:127.0.0.1:{port}", "--speed", "2") as vehicle:
        vehicle.stdout.readline()
        endpoint = ("--endpoint", f"udpout:127.0.0.1:{port}")
        follows = ("--set", 'link.clock="autopilot"')
        ran = circnav("preflight", "copter", *endpoint, "--seconds", "8", *follows, *UNHURRIED)
        vehicle.terminate()
        vehicle.communicate(timeout=PATIENCE)
    assert "and the run follows it" in ran.done
