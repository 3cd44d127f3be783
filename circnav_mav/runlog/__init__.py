"""Recorded flights: run folders and tlogs read back, their figures, replay and export. Never takes part in a flight."""
