"""Plots and report page of a run."""
