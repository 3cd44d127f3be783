"""`circnav emulate VEHICLE --fleet N`: N bundled vehicles in real time, each on its own port."""

import select
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from circnav_mav.cli.exits import Exit, Refused, say
from circnav_mav.extras.fleet.flight import member_overrides
from circnav_mav.mission.load import load_mission
from circnav_mav.runtime.endpoint import LinkError, parse_endpoint
from circnav_mav.runtime.runner import StopRequest


def emulate_fleet(
    endpoint: str,
    *,
    vehicle: str | None,
    fleet: int,
    ranging_endpoint: str | None,
    speed: float,
    seed: int | None,
    duration: float | None,
    **options: Any,
) -> int:
    """Run the vehicles until SIGINT or SIGTERM. Raises Refused."""
    if vehicle is None:
        raise Refused("--fleet: name a mission with a [sim] table, such as plane")
    if ranging_endpoint is not None:
        raise Refused(
            "--ranging-endpoint: not with --fleet, choose a mission that receives ranges on the"
            " vehicle's link"
        )
    try:
        first = parse_endpoint(endpoint)
    except LinkError as error:
        raise Refused(f"--endpoint {error}") from None
    stop = StopRequest()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as running:
        processes = []
        for member in range(1, fleet + 1):
            given = [] if seed is None else [f"sim.seed={seed}"]
            overrides = [
                *member_overrides(vehicle, member, given, fleet),
                f"sim.vehicle.system_id={member}",
            ]
            file = Path(folder) / f"{member}.toml"
            file.write_text(load_mission(vehicle, overrides).text, encoding="utf-8")
            # Difference between the ports of two members, as in ArduPilot's simulator.
            port = first.port + 10 * (member - 1)
            where = f"{first.kind}:{first.host}:{port}"
            lasts = [] if duration is None else ["--duration", str(duration)]
            command = [
                sys.executable,
                "-P",
                "-m",
                "circnav_sim",
                str(file),
                "--endpoint",
                where,
                "--speed",
                str(speed),
            ]
            processes.append(process := subprocess.Popen([*command, *lasts]))
            running.callback(process.wait)
            running.callback(process.terminate)
            named = [one for one in overrides if one.startswith(("fleet.", "orbit."))]
            keys = " ".join(f"--set {one}" for one in [*named, f"vehicle.system_id={member}"])
            say(f"member {member} on {where}: fly it with {keys}")
        while any(process.poll() is None for process in processes) and stop.signal_name is None:
            # Time between two checks of the processes, s.
            select.select([stop], [], [], 0.2)
    return Exit.DONE
