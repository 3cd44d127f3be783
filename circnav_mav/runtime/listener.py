"""The loop of a survey: the runner's, without a recorder, for nothing is flown."""

from collections.abc import Mapping

from circnav_mav.pilot import RANGING, VEHICLE
from circnav_mav.pilot.survey import Survey
from circnav_mav.runtime.clock import RunClock
from circnav_mav.runtime.keys import SigningTime
from circnav_mav.runtime.links import Link
from circnav_mav.runtime.runner import LONGEST_WAIT, StopRequest, wait


def listen(
    survey: Survey,
    links: Mapping[str, Link],
    clock: RunClock,
    stop: StopRequest,
    signing_time: SigningTime | None = None,
) -> None:
    """Listen until the survey is done or a signal has come."""
    while not survey.done and stop.signal_name is None:
        wait(links, stop, min(clock.until(survey.next_tick), LONGEST_WAIT))
        now = clock.now()
        if signing_time is not None:
            signing_time.turn()
        for name, link in links.items():
            for data, source in link.receive(now):
                survey.receive(data, now, source, name)
        out = survey.step(now)
        if out:
            links[VEHICLE].send(out, survey.reply_to)
        if RANGING in links and (hello := survey.hello(now)):
            links[RANGING].send(hello, None)
