"""`circnav paper`, which reproduces the paper, against an independent simulation of 2000 starts,
the paper's lemmas and the mirror image."""

import numpy as np
import pytest

from circnav_mav.extras.paper.paper import (
    EXAMPLES,
    R_D,
    Example,
    arc,
    draw,
    entries,
    lyapunov,
    random_starts,
    shown_start,
    study,
    table,
)
from tests.command_line import terminal

STARTS = random_starts(24, 3)


@pytest.fixture(scope="module")
def studied():
    return {example.number: study(example, STARTS, 150.0) for example in EXAMPLES}


@pytest.mark.parametrize(
    ("number", "radius", "within", "median"),
    [(1, 10.98684113, 1e-4, 28), (2, 10.0, 1e-4, 30), (3, 10.0, 1e-3, 42)],
)
def test_every_start_reaches_radius_of_paper(studied, number, radius, within, median):
    found, _ = studied[number]
    assert found.reached == pytest.approx((radius, radius), abs=within)
    assert found.example.predicted == pytest.approx(radius, abs=1e-7)
    assert found.clockwise == found.starts == 24
    assert np.isfinite(found.settling).all()
    assert np.median(found.settling) == pytest.approx(median, abs=5)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_simulated_laws_satisfy_lemmas_of_paper(studied, number):
    found, _ = studied[number]
    assert found.most_entries <= 1
    assert 0 <= found.bearings[0] <= found.bearings[1] <= np.pi
    assert found.rise is None or found.rise < 1e-9


@pytest.mark.parametrize("number", [1, 2, 3])
def test_negative_gain_mirrors_simulated_track(studied, number):
    found, _ = studied[number]
    assert found.mirror < 1e-3
    assert found.mirrored_counterclockwise == 24


def test_simulated_arc_is_exact():
    """A quarter of a circle of radius 2 to the left leads from (0, 0) with heading 0 to (2, 2) with
    heading pi/2."""
    x, y, heading = arc(np.zeros(1), np.zeros(1), np.zeros(1), 1.0, np.array([0.5]), np.pi)
    assert (x[0], y[0], heading[0]) == pytest.approx((2.0, 2.0, np.pi / 2))
    x, y, heading = arc(np.zeros(1), np.zeros(1), np.zeros(1), 3.0, np.zeros(1), 2.0)
    assert (x[0], y[0], heading[0]) == (6.0, 0.0, 0.0)


def test_lyapunov_integral_matches_the_paper():
    """The closed form of the integral against the trapezoidal rule. The Lyapunov function is zero
    at r_a with theta_b = pi/2."""
    r_d = 10.0
    r_a = 10.98684113
    k = 0.01
    z = np.linspace(r_a, 25.0, 200_001)
    values = -1 / z + 2 * k * z * np.cos(np.arcsin(r_d / z))
    by_hand = np.sum((values[1:] + values[:-1]) / 2) * (z[1] - z[0])
    found = lyapunov(np.array([r_a, 25.0]), np.full(2, np.pi / 2), r_d=r_d, r_a=r_a, k=k)
    assert found == pytest.approx([0.0, by_hand], abs=1e-7)


def test_entries_into_circle_are_counted():
    assert list(
        entries(np.array([[12.0, 9.0], [9.0, 9.0], [12.0, 12.0], [9.0, 12.0], [10.2, 12.0]]), R_D)
    ) == [2, 1]


def test_steady_radius_depends_on_gain():
    found, _ = study(Example(1, "smooth", 0.02, R_D), random_starts(5, 1), 100.0)
    assert found.reached == pytest.approx((found.example.predicted,) * 2, abs=0.01)
    assert f"| {found.example.predicted:.5f} m" in table([found])


def test_paper_command_writes_six_figures_and_table(circnav, tmp_path, monkeypatch):
    """The command runs on a terminal, where it shows its progress."""
    monkeypatch.setenv("TERM", "xterm")
    out = tmp_path / "paper"
    with terminal() as on_terminal:
        ran = circnav("paper", "--out", out, "--starts", "1", "--format", "svg")
    assert "10.98684 m" in ran.done
    for shown in ("flying the examples", "drawing the examples"):
        assert shown in b"".join(on_terminal).decode()
        assert shown not in ran.out
    names = {path.name for path in out.iterdir()}
    figures = {f"example_{n}_{kind}.svg" for n in (1, 2, 3) for kind in ("track", "error")}
    assert names == figures | {"table.md"}


def test_track_in_paper_figure_stays_outside_circle(studied):
    shown = shown_start([findings for findings, _ in studied.values()])
    assert studied[1][1].r[:, shown].min() >= R_D


def test_smooth_law_in_paper_figure_settles_before_switching_law(studied):
    found = [findings for findings, _ in studied.values()]
    shown = shown_start(found)
    assert found[0].settling[shown] < found[2].settling[shown]


@pytest.mark.parametrize(
    ("form", "magic", "date"),
    [
        ("png", b"\x89PNG", b"Creation Time"),
        ("pdf", b"%PDF", b"/CreationDate"),
        ("svg", b"<?xml", b"dc:date"),
    ],
)
def test_paper_figures_have_given_format_and_no_date(tmp_path, form, magic, date):
    for path in draw(tmp_path, EXAMPLES[0], random_starts(1, 1), form):
        figure = path.read_bytes()
        assert figure.startswith(magic)
        assert date not in figure


def test_wrong_usage_of_paper_command_is_refused_without_writing(circnav, mission):
    assert circnav("paper", "--out", "mission.toml").refused == "mission.toml: File exists"
    assert circnav("paper", "--starts", "1", "--out=").refused == "--out: is empty, give it a name"
    for option in ("--starts=0", "--seed=-1"):
        assert circnav("paper", option).code == 2
    assert list(mission.parent.iterdir()) == [mission]
