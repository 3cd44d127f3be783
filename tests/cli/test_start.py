"""Modules loaded by the library and by each command: only the necessary ones, and slow ones before
they are used."""

import json
import subprocess
import sys

RUN = """
import contextlib, io, json, sys
from circnav_mav.cli import main
sys.argv = ["circnav", *{arguments!r}]
{before}
with contextlib.redirect_stdout(io.StringIO()):
    try:
        main()
    except SystemExit as end:
        code = end.code
print(json.dumps({after}))
"""
SLOW = {"scipy", "filterpy", "matplotlib", "rich", "tomlkit"}


def result_of(arguments, after, before=""):
    program = RUN.format(arguments=arguments, before=before, after=after)
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return json.loads(ran.stdout)


def test_quick_commands_load_no_slow_modules(tmp_path):
    more = {"numpy", "pymavlink", "pydantic"}
    for arguments, slow in (
        (["--help"], SLOW | more),
        (["init", "plane", str(tmp_path / "plane.toml")], SLOW | more),
        (["check", "quickstart"], SLOW),
        (["params", "plane"], SLOW),
        (["preflight", "quickstart", "--seconds", "1"], SLOW),
    ):
        code, loaded = result_of(arguments, "[code, sorted(sys.modules)]")
        assert code == 0
        assert not slow & set(loaded), arguments


WATCHED = """
import importlib, signal
from circnav_mav.pilot import Pilot
fly = importlib.import_module("circnav_mav.cli.fly")  # the attribute `cli.fly` is a command
loaded, receive = [], Pilot.receive

def receive_watched(pilot, *arguments):
    receive(pilot, *arguments)
    if pilot.tracker.newest is not None:
        loaded.append("scipy.optimize" in sys.modules)

class Drawing(fly.Drawing):
    def draw(self):
        loaded.append("matplotlib" not in sys.modules)
        signal.raise_signal(signal.SIGTERM)
        return super().draw()

Pilot.receive, fly.Drawing = receive_watched, Drawing
"""


def test_fly_imports_optimizer_first_and_plotting_last(tmp_path):
    """scipy.optimize, which plans laps, is loaded with the first range, and matplotlib after the
    flight. A signal while pictures are drawn does not change the exit code."""
    arguments = ["fly", "quickstart", "--duration", "3", "--out", str(tmp_path / "run")]
    code, loaded = result_of(arguments, "[code, loaded]", WATCHED)
    assert code == 0
    assert len(loaded) > 100
    assert all(loaded)
    assert (tmp_path / "run" / "report.html").stat().st_size > 10_000


LIBRARY = """
import sys
import circnav_mav
assert "numpy" not in sys.modules
from circnav_mav import Guidance
assert "numpy" in sys.modules
import circnav_mav.cli.fly
from filterpy import stats
from filterpy.kalman import KalmanFilter
assert abs(stats.gaussian(0.0, 0.0, 1.0) - 0.3989) < 1e-3
one = KalmanFilter(1, 1)
one.H[:] = 1.0
one.predict()
one.update(1.0)
assert 0.0 < one.likelihood < 1.0
parts = [module for name, module in sys.modules.items() if name.partition(".")[0] == "filterpy"]
assert parts and all(part.__spec__ is not None and part.__file__ for part in parts)
"""


def test_imports_load_numpy_late_but_filterpy_completely():
    subprocess.run([sys.executable, "-c", LIBRARY], check=True)
