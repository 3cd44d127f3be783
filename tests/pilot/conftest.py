"""A pilot on a bench: frames in, frames out, no link and no vehicle."""

from tests.rig import make_rig, rig

__all__ = ["make_rig", "rig"]
