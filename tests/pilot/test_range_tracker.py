"""The range tracker: ranges accepted or rejected by sender and value, and the effects of their
delay."""

from itertools import count, pairwise
from random import Random

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.pilot import RANGING, OutputMode, Phase
from circnav_mav.pilot.status_text import waits_for
from tests.rig import ANY_SENSOR, Rig, Voice, beacon, decode, distance, heartbeat, scattering

GUIDED = 4
LOITER = 5


# --- other senders


def test_tracker_rejects_same_component_of_another_vehicle():
    rig = Rig("ranging.component_id=192")
    received = []
    ours = Voice(1, 192)
    theirs = Voice(2, 192)
    their_vehicle = Voice(2, 1)
    rig.run(0.5, ranges=False)

    def both_radios():
        rig.receive(heartbeat(GUIDED), voice=their_vehicle)
        rig.range(4000, voice=theirs)
        rig.range(15000, voice=ours)
        received.append(rig.pilot.tracker.newest)

    rig.run(5.0, both_radios)
    assert {sample.r for sample in received if sample and sample.time > 2.0} <= {150.0, 150.01}
    assert received[-1].time > rig.now - 0.2


def test_replacement_radio_before_flight_gets_new_clock_estimate(rig):
    other = Voice(system=77, component=192)
    for _ in range(20):
        rig.run(0.1, mode=LOITER, ranges=False)
        rig.receive(scattering(4000, 500_000 + round(rig.now * 1000)), voice=other)
    rig.run(6.0).run(0.5, ranges=True)
    assert rig.pilot.tracker.newest.r == pytest.approx(150.0, abs=0.02)
    # the rig may repeat a value
    assert set(rig.pilot.tracker.ranging.rejected) <= {"repeat"}


@pytest.mark.parametrize("output_mode", [OutputMode.FLY, OutputMode.DRY_RUN])
def test_tracker_accepts_no_replacement_radio_in_flight(output_mode):
    """Only in a dry run may another radio replace the first one."""
    rig = Rig(output_mode=output_mode).engage()
    other = Voice(system=77, component=192)
    since = rig.now
    rig.run(9.0, lambda: rig.range(4000, voice=other), ranges=False)
    newest = rig.pilot.tracker.newest
    if output_mode is OutputMode.FLY:
        assert rig.pilot.mission.phase is Phase.COASTING and newest.time <= since
    else:
        assert newest.r == pytest.approx(40.0, abs=0.02)


GENERIC = 0
INVALID = 8
ARDUPILOT = 3
"""Members of MAV_AUTOPILOT: the heartbeat's autopilot field."""


@pytest.mark.parametrize(
    ("radio", "speaker", "autopilot", "begins", "source"),
    [
        (192, 192, INVALID, 0.0, "vehicle"),
        (192, 192, ARDUPILOT, 0.0, "vehicle"),
        (1, 1, GENERIC, 0.0, "vehicle"),
        (1, 1, INVALID, 0.0, "vehicle"),
        (192, 1, ARDUPILOT, 5.0, "vehicle"),
        (1, 1, ARDUPILOT, 5.0, "elsewhere"),
    ],
    ids=[
        *(
            "invalid",
            "autopilot",
            "generic, component 1",
            "invalid, component 1",
            "vehicle of same system in flight",
        ),
        "other sender in flight",
    ],
)
def test_ranges_of_radio_are_accepted_after_its_heartbeat(
    rig, radio, speaker, autopilot, begins, source
):
    radio = Voice(42, radio)
    speaker = Voice(42, speaker)
    rig.run(0.5, ranges=False)

    def speaks():
        if rig.now > begins and rig.tick % 5 == 0:
            rig.receive(
                heartbeat(kind=2 if begins else 0, autopilot=autopilot),
                voice=speaker,
                source=source,
            )
        if rig.tick % 2:
            rig.range(voice=radio)

    assert rig.run(15.0 if begins else 5.0, speaks).pilot.mission.phase is Phase.ENGAGED


def test_ranges_of_sender_are_rejected_after_its_autopilot_heartbeat(rig):
    other = Voice(42, 1)

    def speaks():
        if rig.now > 5.0 and rig.tick % 5 == 0:
            rig.receive(heartbeat(), voice=other)
        if rig.tick % 2:
            rig.range(voice=other)

    assert rig.run(5.0, speaks, ranges=False).pilot.mission.phase is Phase.ENGAGED
    assert rig.run(1.0, speaks).pilot.mission.phase is Phase.COASTING


@pytest.mark.parametrize("cm", [30_000, 50_000, 4_000])
def test_range_jump_beyond_vehicle_speed_loses_range(rig, cm):
    """Examples: the radio changes its unit or its anchor, or reports its largest range. The filter
    once followed such jumps after 1 s."""
    rig.engage().run(5.0, range_cm=cm)
    assert (
        rig.pilot.mission.phase is Phase.COASTING
        and rig.pilot.tracker.newest.r == pytest.approx(150.0, abs=0.02)
    )
    assert "circnav: range jumped, rejected" in rig.texts()
    assert rig.run(3.0, range_cm=15_000).pilot.mission.phase is Phase.ENGAGED
    assert rig.run(20.0, range_cm=cm).pilot.mission.outcome.reason.endswith(
        f"they jumped by {cm / 100 - 150:+.0f} m"
    )


# --- one source


def two(rig, *, equal_stamps=True, **other):
    """Return a function that sends the ranges of two sensors of one radio at 10 Hz: the mission's
    sensor and another sensor."""
    both = {"id": 1, "orientation": 24, **other}

    def speaks():
        if rig.tick % 2 == 0:
            stamp = 1_000_000 + round(rig.now * 1000)
            rig.receive(scattering(15000, stamp))
            rig.receive(scattering(4000, stamp + (0 if equal_stamps else 20), **both))

    return speaks


NOT_ENGAGED = (
    "2 range sources: 1/1 sensor_id 0 orientation 24 (150.0 m), 1/1 sensor_id 1 orientation {}"
    " (40.0 m): "
)


@pytest.mark.parametrize("equal_stamps", [True, False])
@pytest.mark.parametrize(
    ("other", "keys"),
    [({}, "ranging.sensor_id"), ({"orientation": 2}, "ranging.sensor_id or ranging.orientation")],
    ids=["sensors", "orientations"],
)
def test_two_range_sensors_prevent_engagement_until_one_is_selected(equal_stamps, other, keys):
    """The mission does not select a sensor, as one written by `init`. The waiting text contains the
    ids, the ranges and the key that selects a sensor."""
    rig = Rig("link.wait_s=10.0", text=ANY_SENSOR)
    rig.run(8.0, two(rig, equal_stamps=equal_stamps, **other), ranges=False)
    expected = NOT_ENGAGED.format(other.get("orientation", 24)) + f"select yours by {keys}"
    assert waits_for(rig.pilot, rig.now) == expected
    assert rig.setpoints() == []
    assert "circnav: 2 range sources: set ranging.sensor_id" in rig.texts()
    assert (
        rig.run(5.0, two(rig, equal_stamps=equal_stamps, **other)).pilot.mission.outcome.reason
        == expected
    )
    named = Rig("ranging.sensor_id=0", text=ANY_SENSOR)
    named.run(5.0, two(named, equal_stamps=equal_stamps, **other), ranges=False)
    assert named.pilot.mission.phase is Phase.ENGAGED
    assert named.pilot.tracker.newest.r == pytest.approx(150.0, abs=0.02)
    assert set(named.pilot.tracker.ranging.rejected) == {"other_sensor"}


def test_slow_second_sensor_prevents_engagement():
    """The second sensor measures once per second. The pilot therefore listens for some time before
    it engages."""
    rig = Rig(text=ANY_SENSOR)

    def late():
        if rig.tick % 20 == 19:
            rig.receive(scattering(4000, 1_000_000 + round(rig.now * 1000), id=1))

    assert rig.run(8.0, late).pilot.mission.phase is Phase.WAIT_RANGING
    assert rig.setpoints() == []


def test_second_sensor_in_flight_changes_no_setpoint():
    rig = Rig(text=ANY_SENSOR).engage()
    alone = Rig(text=ANY_SENSOR).engage()
    rig.run(10.0, two(rig), ranges=False)
    alone.run(10.0)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    assert rig.pilot.tracker.ranging.rejected["other_sensor"] == 100
    assert [m.yaw_rate for m in rig.setpoints(4.0)] == [m.yaw_rate for m in alone.setpoints(4.0)]


def test_remaining_sensor_is_accepted_after_other_stops():
    rig = Rig(text=ANY_SENSOR)
    rig.run(4.0, two(rig), ranges=False)
    assert rig.run(4.0, ranges=True).pilot.mission.phase is Phase.WAIT_RANGING
    assert rig.run(4.0).pilot.mission.phase is Phase.ENGAGED


def test_missing_value_name_is_reported_with_received_names():
    rig = Rig("ranging.message=named_value_float", "ranging.name=UWB")
    values = [
        mavlink.MAVLink_named_value_float_message(0, name, 30.0) for name in (b"UWB1", b"UWB2")
    ]
    rig.run(3.0, lambda: [rig.receive(value) for value in values], ranges=False)
    waits = waits_for(rig.pilot, rig.now)
    assert (
        "received: 1/1 name UWB1 (30.0 m), 1/1 name UWB2 (30.0 m), which the mission does not"
        " select" in waits
    )
    assert "compare ranging.name" in waits


# --- ranges faster than the tick rate


def fast(rig, hz, values=lambda n: 15000 + n % 2):
    """Return a function that sends the ranges of a tick at a rate above the tick rate, with a step
    after each."""

    number = count(1)

    def speaks():
        for n in range(round(hz * 0.05)):
            rig.now = round(rig.tick * 0.05 + (n + 1) / hz, 6)
            rig.receive(distance(values(next(number)), 1_000_000 + round(1000 * rig.now)))
            rig.step()

    return speaks


@pytest.mark.parametrize("hz", [100, 200, 1000])
def test_several_ranges_per_tick_give_one_setpoint(hz):
    rig = Rig().engage()
    taken = []
    observe = rig.pilot.tracker.estimator.observe
    since = rig.now
    rig.pilot.tracker.estimator.observe = lambda sample: taken.append(sample) or observe(sample)
    before = rig.pilot.tracker.accepted
    rig.run(4.0, fast(rig, hz), ranges=False)
    assert rig.pilot.mission.phase is Phase.ENGAGED
    assert 4 * 20 - 2 <= len(rig.setpoints(since)) <= 4 * 27
    assert len(taken) <= 4 * 27
    assert rig.pilot.tracker.accepted - before == pytest.approx(4 * hz, rel=0.02)
    assert max(b.time - a.time for a, b in pairwise(taken[1:])) < 0.06


def test_outlier_among_merged_ranges_has_no_effect():
    """One range in twenty at 400 Hz is 250 m too long. The mean range of a tick would be 12 m too
    long."""
    rig = Rig().engage()
    rig.run(3.0, fast(rig, 400, lambda n: 40000 if n % 20 == 0 else 15000 + n % 2), ranges=False)
    assert rig.pilot.tracker.newest.r == pytest.approx(150.0, abs=0.1)
    assert rig.pilot.tracker.newest.sigma < 0.5


# --- unusable ranges


def test_outlier_is_counted_without_effect_on_setpoints():
    steady = Rig().engage()
    disturbed = Rig().engage()
    disturbed.now = steady.now = round(steady.now + 0.04, 6)
    disturbed.range(40000)
    for rig in (steady, disturbed):
        rig.run(0.3, ranges=False)
    assert disturbed.pilot.tracker.ranging.rejected["gated"] == 1
    assert disturbed.pilot.tracker.accepted == steady.pilot.tracker.accepted
    rates = [[m.yaw_rate for m in rig.setpoints(3.02)] for rig in (steady, disturbed)]
    assert rates[0] == pytest.approx(rates[1], abs=2e-3)


def test_sensor_clock_jump_restarts_estimate(rig):
    rig.engage()
    for i in range(30):
        rig.run(0.1, ranges=False).receive(distance(15000, 5_000 + 100 * i))
    assert rig.pilot.tracker.ranging.rejected["stamp_jump"] == 2
    assert rig.pilot.mission.phase is Phase.ENGAGED


@pytest.mark.parametrize("accuracy_mm", [80_000, 4_294_967_294])
def test_tracker_rejects_range_of_excessive_sigma(accuracy_mm):
    rig = Rig("ranging.message=ranging_beacon", "ranging.endpoint=udpin:127.0.0.1:14560")
    for i in range(100):
        message = beacon(150_000, 1_000_000 + i * 100_000, i, range_accuracy=accuracy_mm)
        rig.run(0.1).receive(message, link=RANGING)
    assert rig.pilot.tracker.accepted == 0
    assert rig.pilot.tracker.ranging.rejected["too_noisy"] == 100


@pytest.mark.parametrize(
    ("round_trip", "delay"),
    [(0.0, pytest.approx(2.7, abs=0.15)), (None, pytest.approx(2.7, abs=0.15)), (2.0, None)],
)
def test_constant_range_delay_is_treated_as_clock_offset(round_trip, delay):
    """The ranges stop for 2 s and are 2 s late afterwards. Without answers to TIMESYNC, a delay
    cannot be distinguished from a clock offset."""
    rig = Rig().run(15.0, round_trip=0.0 if round_trip is not None else None)
    since = rig.now
    rig.run(2.0, round_trip=round_trip, ranges=False)
    behind = None
    for _ in range(120):
        rig.run(0.05)
        if rig.tick % 2 == 0:
            rig.receive(scattering(15000, 1_000_000 + round((rig.now - 2.0) * 1000)))
        if behind is None and rig.pilot.tracker.newest.time > since + 0.1:
            behind = rig.now - since
    assert behind == delay
    assert rig.pilot.tracker.ranging.rejected["clock"] >= 4
    assert bool(rig.pilot.tracker.ranging.rejected["too_old"] > 10) == (delay is None)


def test_ranges_with_scatter_above_half_radius_are_lost():
    """A range with a measured scatter above half of the radius cannot be used for steering."""
    draw = Random(3)
    rig = Rig("exit.action=rtl").engage()
    since = rig.now
    rig.run(30.0, lambda: rig.tick % 2 or rig.range(draw.randrange(3000, 60000)), ranges=False)
    steered = [time for time, sent in rig.sent if time > since + 1.0 and getattr(sent, "vx", 0) > 0]
    assert rig.pilot.mission.outcome is not None and rig.pilot.mission.outcome.reason.startswith(
        "no range for"
    )
    assert steered and steered[-1] - since < 15.0


def test_outcome_names_estimator_when_ranges_give_no_estimate():
    rig = Rig("guidance.estimator=drift").run(10.0)
    assert "estimator drift has not converged" in waits_for(rig.pilot, rig.now)


# --- delay


@pytest.mark.parametrize(("stale", "phase"), [(0.5, Phase.COASTING), (1.5, Phase.ENGAGED)])
def test_link_delay_above_range_age_limit_loses_range(stale, phase):
    """The delay is constant, so stamps do not show it. Answers to TIMESYNC do."""
    rig = Rig(f"limits.stale_s={stale}").engage().run(8.0, round_trip=2.0)
    assert rig.pilot.session.timesync.typical == pytest.approx(2.0)
    assert rig.pilot.mission.phase is phase
    ended = rig.run(8.0).pilot.mission.outcome
    assert bool(ended and ended.reason.startswith("no range for")) is (phase is Phase.COASTING)


def test_delay_of_vehicle_link_does_not_affect_ranging_link():
    rig = Rig("ranging.endpoint=udpin:127.0.0.1:14560")

    def by_radio():
        if rig.tick % 2 == 0:
            rig.range(link=RANGING)

    assert rig.run(3.0, by_radio, ranges=False).pilot.mission.phase is Phase.ENGAGED
    rig.run(15.0, by_radio, round_trip=2.0)
    assert rig.pilot.session.timesync.typical == pytest.approx(2.0)
    assert rig.pilot.mission.phase is Phase.ENGAGED


# --- a separate link


def test_ranges_are_accepted_only_on_their_configured_link():
    rig = Rig("ranging.endpoint=udpin:127.0.0.1:14560").run(3.0)
    assert rig.pilot.tracker.accepted == 0, "ranges on the vehicle's link are rejected"
    rig.run(3.0, lambda: rig.tick % 2 or rig.range(link=RANGING, source="radio"), ranges=False)
    assert rig.pilot.mission.phase is Phase.ENGAGED


def test_ranging_link_gets_one_heartbeat_per_second():
    rig = Rig("ranging.endpoint=udpin:127.0.0.1:14560")
    hellos = [message for i in range(61) for message in decode(rig.pilot.hello(i / 20))]
    assert [message.get_type() for message in hellos] == ["HEARTBEAT"] * 4


def test_vehicle_on_ranging_link_is_ignored():
    rig = Rig("ranging.endpoint=udpin:127.0.0.1:14560")
    rig.run(
        2.0,
        lambda: rig.receive(heartbeat(GUIDED), link=RANGING, source="radio"),
        speaks=False,
        ranges=False,
    )
    assert rig.pilot.mission.phase is Phase.WAIT_LINK


def test_autopilot_reboot_resets_range_estimate():
    rig = Rig("engage.on_takeover=wait").engage()
    rig.receive(mavlink.MAVLink_system_time_message(0, 900_000))
    rig.run(0.5).now_is(ranges=False)
    assert rig.pilot.take_records()[-1].r == pytest.approx(150.0, abs=0.5)
    for boot_ms in (2_000, 2_050):
        rig.receive(mavlink.MAVLink_system_time_message(0, boot_ms))
    assert [record.r for record in rig.run(0.05).pilot.take_records()] == [None]
    assert not rig.pilot.tracker.estimator.ready
