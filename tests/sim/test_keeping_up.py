"""In real time the vehicle says when the computer cannot keep up."""

import pytest

from sim import server
from sim.config import parse_vehicle
from sim.vehicle import Vehicle


@pytest.mark.parametrize(("step", "said"), [(0.05, 0), (0.3, 2)])
def test_it_says_so_in_one_line_every_ten_seconds(monkeypatch, step, said):
    """Each turn of its loop takes a time on the wall, s; 15 s pass."""
    wall, lines = [100.0], []
    monkeypatch.setattr(server.time, "monotonic", lambda: wall[0])
    monkeypatch.setattr(server, "_speak", lambda *_: None)
    monkeypatch.setattr(server, "_sleep", lambda *_: wall.__setitem__(0, wall[0] + step))
    server._fly(Vehicle(parse_vehicle({}, "here")), {}, 1.0, None, lambda: wall[0] > 115.0, lines.append)
    assert len(lines) == said
    assert all(line.startswith("sim: this computer cannot keep up: simulated time is 0.3 s behind") for line in lines)
