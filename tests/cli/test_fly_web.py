"""`circnav fly --web`: refusals in one line, and the page of a real flight in a real browser."""

import re
import socket

import pytest

from circnav_mav.runtime.web.feed import LivePage
from tests.flight.lockstep import flight
from tests.process import PATIENCE
from tests.process import circnav as process_of


def test_a_port_in_use_is_refused_before_anything_flies(circnav, mission, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        line = circnav("fly", mission, "--web", port, "--out", tmp_path / "out").refused
    assert line.startswith(f"--web {port}: 127.0.0.1:{port} cannot be had: Address already in use")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_flight_without_a_vehicle_ends_as_it_does_without_the_page(circnav, mission):
    ran = circnav("fly", mission, "--web", 0)
    assert (ran.code, ran.err) == (3, "")
    assert re.search(r"live page at http://127\.0\.0\.1:\d+/\n", ran.out)


DESIRED_ON_TOP = """
[...document.querySelectorAll("#track circle.level, #track path.line")].at(-1).matches("circle")"""


def test_a_browser_follows_a_flight_to_its_verdict_and_logs_no_error(browser, tmp_path):
    options = ("--web", "0", "--speed", "2", "--duration", "12", "--out", str(tmp_path / "run"))
    with process_of("fly", "quickstart", *options) as flown:
        said = next(line for line in flown.stdout if line.startswith("live page at "))
        browser.open(said.split()[-1])
        browser.until("document.getElementById('phase').innerText.toLowerCase() === 'engaged'")
        browser.until("document.querySelectorAll('#charts svg.strip').length === 7")
        browser.until("points.length > 20 && document.querySelector('#track path.line.true')")
        longest = "svg => Math.max(...[...svg.querySelectorAll('path.line')].map(path => path.getTotalLength()))"
        lines = "[...document.querySelectorAll('#charts svg.strip')].filter(svg => svg.querySelector('.line'))"
        drawn = browser.value(f"{lines}.map({longest})")
        assert len(drawn) == 4
        assert min(drawn) > 300  # px of line in every chart
        assert browser.value("document.getElementById('link').innerText") == "live"
        assert browser.value(DESIRED_ON_TOP)
        assert re.fullmatch(r"\d{3} deg", browser.value("document.getElementById('heading').innerText"))
        browser.until("!document.getElementById('outcome').hidden")
        assert "COMPLETED: flown to its end" in browser.value("document.getElementById('outcome').innerText")
        assert browser.value("document.getElementById('link').innerText") == "stream ended"
        assert browser.complaints == []
        flown.communicate(timeout=PATIENCE)
    assert flown.returncode == 0


def test_the_page_says_when_the_connection_is_lost(browser):
    page = LivePage(flight("quickstart").pilot, 0, name="small", tolerance=5.0, speed=1.0)
    try:
        browser.open(page.url)
        browser.until("document.getElementById('name').innerText === 'small'")
        page._process.kill()
        browser.until("document.getElementById('link').innerText === 'connection lost, trying again'")
    finally:
        page.close()
