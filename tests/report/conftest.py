"""Run folders to draw."""

from tests.runlog.conftest import run_folder

__all__ = ["run_folder"]
