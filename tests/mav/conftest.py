"""Fixtures with a pilot in a rig: frames in, frames out, without links and vehicle."""

from tests.rig import copter, make_rig, make_session, rig

__all__ = ["copter", "make_rig", "make_session", "rig"]
