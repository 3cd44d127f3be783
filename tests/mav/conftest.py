"""A pilot on a bench: frames in, frames out, no link and no vehicle."""

from tests.rig import copter, make_rig, make_session, rig

__all__ = ["copter", "make_rig", "make_session", "rig"]
