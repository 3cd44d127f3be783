"""Fixtures with a pilot in a rig: frames in, frames out, without links and vehicle."""

from tests.rig import make_rig, rig

__all__ = ["make_rig", "rig"]
