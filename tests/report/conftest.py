"""Run folders to draw."""

from tests.runlog.conftest import epoch_us, run_folder

__all__ = ["epoch_us", "run_folder"]
