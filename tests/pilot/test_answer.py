"""What lies between a range and its setpoint, and what comes behind it."""

from tests.rig import Rig, decode, heartbeat


def test_a_setpoint_is_answered_alone_and_all_else_that_is_due_follows_it():
    rig = Rig().engage()
    answered: set[str] = set()
    followed: set[str] = set()
    for tick in range(30):
        rig.pass_time(0.05)
        if tick % 5 == 0:
            rig.heartbeat()
        rig.range()
        answered |= {message.get_type() for message in decode(rig.pilot.answer(rig.now))}
        followed |= {message.get_type() for message in decode(rig.pilot.follow_up(rig.now))}
        assert rig.pilot.answer(rig.now) == rig.pilot.follow_up(rig.now) == b"", "a range is answered once"
    assert answered == {"SET_POSITION_TARGET_LOCAL_NED"}
    assert {"HEARTBEAT", "TIMESYNC", "NAMED_VALUE_FLOAT"} <= followed - answered


def test_the_filter_prepares_nothing_between_a_range_and_its_setpoint_whatever_else_comes_with_it(monkeypatch):
    """One datagram of a router holds a range and more; in a replay its frames come one by one."""
    rig = Rig().engage()
    estimator, order = rig.pilot.tracker.estimator, list[str]()
    settle = estimator.settle
    rig.pilot.take_records()
    rig.pass_time(0.1)
    rig.range()
    monkeypatch.setattr(estimator, "settle", lambda: order.append("settled") or settle())
    rig.hear(heartbeat())
    assert rig.pilot.answer(rig.now)
    order.append("answered")
    rig.pilot.follow_up(rig.now)
    rig.pilot.take_records()
    assert order == ["answered", "settled"]
