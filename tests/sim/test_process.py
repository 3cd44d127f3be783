"""The emulator as a process on real sockets."""

import signal
import socket
import time

import pytest
from circnav_sim import server
from circnav_sim.__main__ import main
from circnav_sim.config import parse_vehicle
from circnav_sim.vehicle import Vehicle
from click.testing import CliRunner
from pymavlink.dialects.v20 import all as mavlink

from tests.process import PATIENCE, python, running

HEARTBEAT = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)


@pytest.fixture
def wire():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        yield made


def emulator(*arguments):
    return running(python("-m", "sim", *arguments))


def called(wire, port):
    """Connect the socket to the emulator's port and send a heartbeat, so that the emulator knows
    the sender."""
    wire.connect(("127.0.0.1", port))
    send_to(wire, HEARTBEAT)
    return wire


def send_to(wire, message):
    wire.send(message.pack(mavlink.MAVLink(None, 1, 191)))


def command(wire, *numbers):
    send_to(
        wire,
        mavlink.MAVLink_command_long_message(
            1, 1, numbers[0], 0, *numbers[1:], *[0] * (8 - len(numbers))
        ),
    )


def receive_from(wire, kind, seconds=PATIENCE):
    """Return the first message of a type. HEARTBEAT: the first message of the autopilot."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        wire.settimeout(max(0.01, end - time.monotonic()))
        for message in parser.parse_buffer(wire.recv(2048)) or []:
            if message.get_type() == kind and (
                kind != "HEARTBEAT" or message.get_srcComponent() == 1
            ):
                return message
    raise TimeoutError(kind)


def test_emulator_with_udp_client_ends_by_sigterm(wire, port):
    with emulator("--endpoint", f"udpin://127.0.0.1:{port}", "--speed", "5") as process:
        assert process.stdout.readline() == f"sim: arducopter system 1 on udpin:127.0.0.1:{port}\n"
        called(wire, port)
        assert receive_from(wire, "HEARTBEAT").autopilot == 3
        assert receive_from(wire, "DISTANCE_SENSOR").get_srcComponent() == 192
        command(wire, 176, 1, 4)
        assert receive_from(wire, "COMMAND_ACK").result == 0
        fast = (0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0.2)
        send_to(
            wire, mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 8, 0x5C7, *fast)
        )
        while receive_from(wire, "SIM_STATE").vn < 1.0:
            pass
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
        assert process.stderr.read() == ""


def test_emulator_serves_separate_streams_to_two_clients(wire, port):
    with (
        emulator("--endpoint", f"udpin:127.0.0.1:{port}", "--speed", "10") as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        assert process.stdout.readline()
        for one in (wire, other):
            receive_from(called(one, port), "HEARTBEAT")
        command(other, 511, 30, 50_000)
        assert receive_from(other, "ATTITUDE")
        with pytest.raises(TimeoutError):
            receive_from(wire, "ATTITUDE", 0.3)


def test_emulator_with_tcp_client_ends_by_sigint(port):
    with emulator("--endpoint", f"tcpin:127.0.0.1:{port}") as process:
        assert process.stdout.readline()
        with socket.create_connection(("127.0.0.1", port)) as connection:
            assert receive_from(connection, "HEARTBEAT").type == 2
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


def test_emulated_direct_radio_uses_separate_endpoint(wire, port, tmp_path):
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('[ranging]\nmessage = "ranging_beacon"\nvia = "direct"\n')
    radio = f"udpout:127.0.0.1:{wire.getsockname()[1]}"
    ends = ("--speed", "20", "--duration", "5")
    endpoints = ("--endpoint", f"udpin:127.0.0.1:{port}", "--ranging-endpoint", radio)
    with emulator(str(vehicle), *endpoints, *ends) as process:
        assert process.stdout.readline().endswith(
            f"on udpin:127.0.0.1:{port}, ranging on {radio}\n"
        )
        assert receive_from(wire, "RANGING_BEACON").range > 0
        assert process.wait(PATIENCE) == 0


def test_emulator_refuses_bad_arguments_in_one_line(wire, port, tmp_path, monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    bad = tmp_path / "bad.toml"
    direct = tmp_path / "direct.toml"
    bad.write_text("[vehicle]\nprofil = 1\n")
    direct.write_text('[ranging]\nvia = "direct"\n')
    for arguments, error in (
        (["--endpoint", f"udpin:127.0.0.1:{wire.getsockname()[1]}"], "in use"),
        (["--endpoint", "carrier-pigeon"], "not an endpoint"),
        (["--endpoint", "udpin:127.0.0.1:99999"], "outside 1 to 65535"),
        ([str(bad)], 'did you mean "profile"?'),
        ([str(tmp_path / "none.toml")], "cannot be read"),
        ([str(direct), "--endpoint", f"udpin:127.0.0.1:{port}"], "--ranging-endpoint"),
    ):
        ran = CliRunner().invoke(main, arguments)
        assert (ran.exit_code, ran.stdout) == (2, ""), arguments
        assert ran.stderr.count("\n") == 1 and error in ran.stderr, ran.stderr


@pytest.mark.parametrize(("step", "warnings"), [(0.05, 0), (0.3, 2)])
def test_emulator_warns_when_computer_is_too_slow(monkeypatch, step, warnings):
    """Parameter: wall time of each step of the emulator's loop, s. The test covers 15 s."""
    wall = [100.0]
    lines = []
    monkeypatch.setattr(server.time, "monotonic", lambda: wall[0])
    monkeypatch.setattr(server, "_send", lambda *_: None)
    monkeypatch.setattr(server, "_sleep", lambda *_: wall.__setitem__(0, wall[0] + step))
    server._fly(
        Vehicle(parse_vehicle({}, "here")), {}, 1.0, None, lambda: wall[0] > 115.0, lines.append
    )
    assert len(lines) == warnings
    assert all(
        line.startswith("sim: this computer cannot keep up: simulated time is 0.3 s behind")
        for line in lines
    )
