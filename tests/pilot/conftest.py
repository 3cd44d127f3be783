"""A pilot on a bench: frames in, frames out, no link and no vehicle."""

from tests.rig import rig

__all__ = ["rig"]
