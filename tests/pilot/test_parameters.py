"""Parameters requested by a ground station, frame by frame: listed, read, set, or refused with the
reason."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

from circnav_mav.guidance.types import Direction
from tests.rig import Voice, decode

GCS = Voice(255, 190)
OURS = (1, 191)
NAMES = ["CN_RADIUS", "CN_DIRECTION", "CN_SPEED", "CN_HEIGHT", "CN_LAW", "CN_COAST", "CN_EXIT"]


def setting(name, value, kind=mavlink.MAV_PARAM_TYPE_REAL32, target=OURS):
    return mavlink.MAVLink_param_set_message(*target, name.encode(), value, kind)


@pytest.fixture
def flying(make_rig):
    rig = make_rig("link.unsigned_parameters=true")
    rig.run(5.0)
    return rig


def values(rig):
    """Return the values of the PARAM_VALUE messages since the last call, by name."""
    found = [message for _, message in rig.sent if message.get_type() == "PARAM_VALUE"]
    rig.sent.clear()
    return {message.param_id: message for message in found}


def after(rig, message, **how):
    rig.sent.clear()
    rig.receive(message, voice=GCS, **how)
    rig.run(1.0)
    return values(rig)


@pytest.mark.parametrize("target", [OURS, (1, 0), (0, 0)], ids=["ours", "vehicle", "everything"])
def test_parameter_list_has_each_parameter_with_its_index(flying, target):
    found = after(flying, mavlink.MAVLink_param_request_list_message(*target))
    assert list(found) == NAMES
    assert [message.param_index for message in found.values()] == list(range(7))
    assert {(message.param_count, message.param_type) for message in found.values()} == {(7, 9)}
    assert found["CN_RADIUS"].param_value == 100.0 and found["CN_DIRECTION"].param_value == 1.0


@pytest.mark.parametrize("request_", [(b"", 2), (b"CN_SPEED", -1)], ids=["by index", "by name"])
def test_parameter_read_returns_value(flying, request_):
    found = after(flying, mavlink.MAVLink_param_request_read_message(*OURS, *request_))
    assert list(found) == ["CN_SPEED"] and found["CN_SPEED"].param_value == 15.0


@pytest.mark.parametrize(
    ("name", "value", "read"),
    [
        ("CN_RADIUS", 80.0, lambda pilot: pilot.controller.orbit.radius),
        ("CN_SPEED", 14.0, lambda pilot: pilot.controller.orbit.speed),
        ("CN_COAST", 20.0, lambda pilot: pilot.mission.coast),
    ],
)
def test_set_parameter_is_applied_and_answered(flying, name, value, read):
    found = after(flying, setting(name, value))
    assert found[name].param_value == value == read(flying.pilot)


def test_direction_and_law_are_set_by_number(flying):
    after(flying, setting("CN_DIRECTION", -1.0))
    after(flying, setting("CN_LAW", 2.0))
    assert flying.pilot.controller.orbit.direction is Direction.COUNTERCLOCKWISE
    assert flying.pilot.controller.law == flying.pilot.take_records()[-1].law == "feedforward"


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (setting("CN_RADIUS", 5.0), "CN_RADIUS not set: radius 5 m: min 43 m by turn rate"),
        (setting("CN_RADIUS", float("nan")), "CN_RADIUS not set: not a finite number"),
        (
            setting("CN_RADIUS", 80.0, mavlink.MAV_PARAM_TYPE_INT32),
            "CN_RADIUS not set: send it as REAL32",
        ),
        (
            setting("CN_DIRECTION", 0.0),
            "CN_DIRECTION not set: 0 is not 1 (clockwise) or -1 (counterclockwise)",
        ),
        (setting("CN_SPEED", 30.0), "CN_SPEED not set: speed 30 m/s outside 12 to 18 m/s"),
        (
            setting("CN_HEIGHT", -1.0),
            "CN_HEIGHT not set: -1 m is below 0: give the height above the target",
        ),
        (
            setting("CN_HEIGHT", 149.0),
            "CN_HEIGHT not set: 149 m leaves no circle at the measured range, 150 m",
        ),
        (
            setting("CN_LAW", 4.0),
            "CN_LAW not set: law auto needs estimator auto, the mission has kalman",
        ),
        (setting("CN_LAW", 0.5), "CN_LAW not set: 0.5 is not a law: 0 smooth, 1 switching"),
        (setting("CN_COAST", 1e9), "CN_COAST not set: 1e+09 s outside 0 to 600 s"),
        (setting("CN_EXIT", 99.0), "CN_EXIT not set: 99 is not an exit action: 0 to 6"),
    ],
)
def test_unflyable_parameter_is_rejected_with_reason_and_old_value(flying, message, reason):
    before = after(flying, mavlink.MAVLink_param_request_list_message(*OURS))
    flying.receive(message, voice=GCS)
    flying.run(1.0)
    texts = "".join(m.text for _, m in flying.sent if m.get_type() == "STATUSTEXT")
    assert f"circnav: {reason}"[:60] in texts
    assert values(flying)[message.param_id].param_value == pytest.approx(
        before[message.param_id].param_value, nan_ok=True
    )


@pytest.mark.parametrize(
    "how",
    [
        {"message": setting("CN_RADIUS", 80.0), "source": "stranger"},
        {"message": setting("CN_RADIUS", 80.0, target=(2, 191))},
        {"message": setting("CN_RADIUS", 80.0, target=(1, 0))},
        {"message": setting("CN_RADIUS", 80.0, target=(1, 1))},
        {"message": setting("RADIUS", 80.0)},
    ],
    ids=["another address", "another vehicle", "every component", "the autopilot", "another name"],
)
def test_parameter_requests_for_other_targets_are_ignored(flying, how):
    assert after(flying, how.pop("message"), **how) == {}
    assert flying.pilot.controller.orbit.radius == 100.0


def test_unsigned_link_sets_parameters_only_with_permission(
    make_rig,
):
    rig = make_rig()
    rig.run(5.0)
    assert list(after(rig, mavlink.MAVLink_param_request_list_message(*OURS))) == NAMES
    assert after(rig, setting("CN_RADIUS", 80.0))["CN_RADIUS"].param_value == 100.0
    assert rig.pilot.controller.orbit.radius == 100.0


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (mavlink.MAVLink_param_request_read_message(*OURS, b"RADIUS", -1), "DOES_NOT_EXIST"),
        (setting("RADIUS", 80.0), "DOES_NOT_EXIST"),
        (setting("CN_RADIUS", 5.0), "VALUE_OUT_OF_RANGE"),
    ],
)
def test_parameter_error_is_reported_to_its_sender(flying, message, error):
    after(flying, setting("CN_SPEED", 15.0))
    flying.receive(message, voice=GCS)
    flying.run(1.0)
    (found,) = [one for _, one in flying.sent if one.get_type() == "PARAM_ERROR"]
    assert (found.target_system, found.target_component, found.param_id, found.error) == (
        255,
        190,
        message.param_id,
        getattr(mavlink, f"MAV_PARAM_ERROR_{error}"),
    )


def test_each_refused_parameter_gets_statustext_with_its_name(flying):
    flying.receive(setting("CN_RADIUS", 5.0), voice=GCS)
    flying.receive(setting("CN_SPEED", 30.0), voice=GCS)
    flying.run(1.0)
    texts = "".join(m.text for _, m in flying.sent if m.get_type() == "STATUSTEXT")
    assert "CN_RADIUS not set: " in texts and "CN_SPEED not set: " in texts


def test_no_parameter_is_set_after_takeover(flying):
    flying.mode = 5
    flying.run(1.0)
    after(flying, setting("CN_RADIUS", 80.0))
    assert flying.pilot.controller.orbit.radius == 100.0


def test_repeated_list_requests_send_one_list(flying):
    flying.sent.clear()
    for _ in range(100):
        flying.receive(mavlink.MAVLink_param_request_list_message(*OURS), voice=GCS)
    flying.run(1.0)
    sent = [(time, m.param_id) for time, m in flying.sent if m.get_type() == "PARAM_VALUE"]
    assert [name for _, name in sent] == NAMES
    assert max(sum(time == at for time, _ in sent) for at, _ in sent) <= 2


def test_pymavlink_decodes_parameter_values(flying):
    flying.receive(mavlink.MAVLink_param_request_read_message(*OURS, b"CN_COAST", -1), voice=GCS)
    flying.run(0.2)
    frames = b"".join(flying.raw)
    assert [m.param_value for m in decode(frames) if m.get_type() == "PARAM_VALUE"] == [10.0]
