"""`circnav fly --web`: the live page of a real flight, also in a browser."""

import re
import socket
from contextlib import closing

import pytest

from circnav_mav.extras.web.feed import LivePage
from circnav_mav.runtime.listeners import Listeners
from tests.flight.lockstep import flight
from tests.process import PATIENCE
from tests.process import circnav as process_of

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.mark.parametrize("options", ["mission.toml --web eighty", "mission.toml --web 65536",
                                     "--web mission.toml mission.toml"])  # fmt: skip
def test_invalid_web_port_is_refused(circnav, mission, options):
    line = circnav("fly", *options.split()).refused
    port = options.partition("--web ")[2].split()[0]
    assert line == f"--web {port}: is not a port; write: circnav fly MISSION --web [PORT]"
    assert list(mission.parent.iterdir()) == [mission]


def test_page_address_is_printed_before_the_flight(circnav, mission):
    ran = circnav("fly", mission, "--web", 0)
    assert (ran.code, ran.err) == (3, "")
    assert re.search(r"live page at http://127\.0\.0\.1:\d+/\n", ran.out)


def test_ssh_session_prints_tunnel_command(circnav, mission, monkeypatch):
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.2 50000 192.168.2.2 22")
    monkeypatch.setenv("LOGNAME", "pi")
    ran = circnav("fly", mission, "--web", 0)
    assert re.search(
        r"from your own computer: ssh -L (\d+):127\.0\.0\.1:\1 pi@192\.168\.2\.2\n", ran.out
    )


def test_web_port_in_use_is_refused_before_flight(circnav, mission, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        line = circnav("fly", mission, "--web", port, "--out", tmp_path / "out").refused
    assert line.startswith(
        f"--web {port}: 127.0.0.1:{port} cannot be used: Address already in use; choose"
    )
    assert not (tmp_path / "out").exists()


def test_page_shows_only_missing_inputs_before_first_step(browser, port):
    with process_of(
        "fly", "quickstart", "--endpoint", f"udpin:127.0.0.1:{port}", "--web", "0"
    ) as waiting:
        address = next(line for line in waiting.stdout if line.startswith("live page at "))
        browser.open(address.split()[-1])
        browser.until("document.getElementById('link').innerText.startsWith('no step yet')")
        parts = "[...document.querySelectorAll('#phase, #tools, #charts svg')]"
        assert browser.value(f"{parts}.filter(part => part.offsetHeight).length") == 0
        waiting.kill()


DESIRED_ON_TOP = """
[...document.querySelectorAll("#track circle.level, #track path.line")].at(-1).matches("circle")"""


def test_browser_shows_flight_until_its_verdict(browser, tmp_path):
    """A radio that is silent for 2 s gives one alarm, although the age in the alarm's text
    changes."""
    silent = 'sim.events=[{at_s=7.0, action="mute_ranging"}, {at_s=9.0, action="unmute_ranging"}]'
    options = (
        "--web",
        "0",
        "--speed",
        "2",
        "--duration",
        "12",
        "--out",
        str(tmp_path / "run"),
        "--set",
        silent,
    )
    with process_of("fly", "quickstart", *options) as flown:
        address = next(line for line in flown.stdout if line.startswith("live page at "))
        browser.open(address.split()[-1])
        browser.until("document.getElementById('phase').innerText.toLowerCase() === 'engaged'")
        browser.until("document.querySelectorAll('#charts svg.strip').length === 7")
        browser.until("points.length > 20 && document.querySelector('#track path.line.true')")
        longest = (
            "svg => Math.max(...[...svg.querySelectorAll('path.line')].map(path =>"
            " path.getTotalLength()))"
        )
        lines = (
            "[...document.querySelectorAll('#charts svg.strip')].filter(svg =>"
            " svg.querySelector('.line'))"
        )
        drawn = browser.value(f"{lines}.map({longest})")
        assert len(drawn) == 4
        # Range, error and turn rate have a line of at least 300 pixels. The drift is known later.
        assert min(drawn[:3]) > 300
        assert browser.value("document.getElementById('link').innerText") == "live"
        assert browser.value(DESIRED_ON_TOP)
        assert re.fullmatch(
            r"\d{3} deg", browser.value("document.querySelector('[data-fact=heading]').innerText")
        )
        browser.until("!document.getElementById('outcome').hidden")
        assert "COMPLETED: flown to its end" in browser.value(
            "document.getElementById('outcome').innerText"
        )
        assert browser.value("document.getElementById('link').innerText") == "stream ended"
        assert browser.value(
            "alarms.map(([, words]) => words.split(' ').slice(0, 2).join(' '))"
        ) == ["RANGE STALE"]
        circle = browser.value("document.getElementById('circle').innerText")
        assert re.fullmatch(
            r"100 m .*\. 2\d+-\d\d-\d\d \d\d:\d\d UTC\. ardupilot copter, firmware 4.6.3", circle
        )
        assert "waiting" not in browser.value("document.getElementById('figures').innerText"), (
            "the finished flight shows no reason for waiting"
        )
        assert browser.value("document.querySelector('[data-fact=range]').innerText").endswith(
            "m horizontal, desired 100.0 m"
        )
        flown.communicate(timeout=PATIENCE)
        # after the flight the page can be reloaded and has a link to the report
        browser.open(address.split()[-1])
        browser.until("document.querySelector('#report a')")
        assert browser.value("document.getElementById('outcome').innerText").startswith("COMPLETED")
        assert str(tmp_path / "run" / "report.html") in browser.value(
            "document.getElementById('report').innerText"
        )
        browser.open(browser.value("document.querySelector('#report a').href"))
        assert browser.value("document.querySelectorAll('svg.strip').length") > 5
        assert browser.complaints == []
    assert flown.returncode == 0


def test_page_shows_lost_connection(browser):
    with closing(
        LivePage(flight("quickstart").pilot, Listeners(), 0, name="small", tolerance=5.0, speed=1.0)
    ) as page:
        browser.open(page.url)
        browser.until("document.getElementById('name').innerText === 'small'")
        page._process.kill()
        browser.until(
            "document.getElementById('link').innerText === 'connection lost, trying again'"
        )
