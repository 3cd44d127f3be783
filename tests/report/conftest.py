"""Run folders for the charts and plots."""

from tests.runlog.conftest import run_folder

__all__ = ["run_folder"]
