"""The emulator as a process on real sockets."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.process import PATIENCE

ROOT = Path(__file__).parents[2]


@contextmanager
def emulator(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "sim", *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def hear(wire: socket.socket, kind: str, seconds: float = PATIENCE) -> Any:
    """The first message of a kind; of heartbeats the autopilot's."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        wire.settimeout(max(0.01, end - time.monotonic()))
        for message in parser.parse_buffer(wire.recv(2048)) or []:
            if message.get_type() == kind and (kind != "HEARTBEAT" or message.get_srcComponent() == 1):
                return message
    raise TimeoutError(kind)


def frame(message: Any) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, 1, 191)))


@pytest.mark.parametrize("spelling", ["udpin:127.0.0.1:{}", "udpin://127.0.0.1:{}"])
def test_a_client_of_a_udp_port_is_served_and_sigterm_ends_cleanly(spelling: str, port: int) -> None:
    with emulator("--endpoint", spelling.format(port), "--speed", "5") as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"sim: arducopter system 1 on udpin:127.0.0.1:{port}\n"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            wire.connect(("127.0.0.1", port))
            wire.send(frame(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)))
            assert hear(wire, "HEARTBEAT").autopilot == 3
            assert hear(wire, "DISTANCE_SENSOR").get_srcComponent() == 192
            wire.send(frame(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)))
            assert hear(wire, "COMMAND_ACK").result == 0
            wire.send(
                frame(
                    mavlink.MAVLink_set_position_target_local_ned_message(
                        0, 1, 1, 8, 0x5C7, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0.2
                    )
                )
            )
            time.sleep(0.2)
            while hear(wire, "SIM_STATE").vn < 1.0:
                pass
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
        assert process.stderr is not None and process.stderr.read() == ""


def test_two_clients_are_two_links_with_their_own_streams(port: int) -> None:
    with emulator("--endpoint", f"udpin:127.0.0.1:{port}", "--speed", "10") as process:
        assert process.stdout is not None and process.stdout.readline()
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
        ):
            for wire in (one, two):
                wire.connect(("127.0.0.1", port))
                wire.send(frame(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)))
                hear(wire, "HEARTBEAT")
            two.send(frame(mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30, 50_000, 0, 0, 0, 0, 0)))
            assert hear(two, "ATTITUDE")
            with pytest.raises(TimeoutError):
                hear(one, "ATTITUDE", 0.3)


def test_udpout_speaks_first_and_the_duration_ends_it() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        port = wire.getsockname()[1]
        with emulator("--endpoint", f"udpout:127.0.0.1:{port}", "--speed", "20", "--duration", "5") as process:
            assert hear(wire, "HEARTBEAT").get_srcSystem() == 1
            assert process.wait(PATIENCE) == 0


def test_a_tcp_client_is_served(port: int) -> None:
    with emulator("--endpoint", f"tcpin:127.0.0.1:{port}") as process:
        assert process.stdout is not None and process.stdout.readline()
        with socket.create_connection(("127.0.0.1", port)) as wire:
            assert hear(wire, "HEARTBEAT").type == 2
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


def test_a_direct_radio_has_its_own_port(port: int, tmp_path: Path) -> None:
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('[ranging]\nmessage = "ranging_beacon"\nvia = "direct"\n')
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        radio = f"udpout:127.0.0.1:{wire.getsockname()[1]}"
        arguments = [str(vehicle), "--endpoint", f"udpin:127.0.0.1:{port}", "--ranging-endpoint", radio]
        with emulator(*arguments):
            assert hear(wire, "RANGING_BEACON").range > 0


def test_what_cannot_be_started_is_said_in_one_line(port: int, tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[vehicle]\nprofil = 1\n")
    direct = tmp_path / "direct.toml"
    direct.write_text('[ranging]\nvia = "direct"\n')
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        cases = {
            ("--endpoint", f"udpin:127.0.0.1:{taken.getsockname()[1]}"): "in use",
            ("--endpoint", "carrier-pigeon"): "not an endpoint",
            ("--endpoint", "udpin:127.0.0.1:99999"): "outside 1 .. 65535",
            (str(bad),): 'did you mean "profile"?',
            (str(tmp_path / "none.toml"),): "cannot be read",
            (str(direct), "--endpoint", f"udpin:127.0.0.1:{port}"): "--ranging-endpoint",
        }
        processes = {
            arguments: subprocess.Popen(
                [sys.executable, "-m", "sim", *arguments], cwd=ROOT, stderr=subprocess.PIPE, text=True
            )
            for arguments in cases
        }
        for arguments, process in processes.items():
            _, errors = process.communicate(timeout=PATIENCE)
            assert process.returncode == 2, arguments
            assert errors.count("\n") == 1 and cases[arguments] in errors, errors
