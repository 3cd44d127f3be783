"""Recorded flights: reading run folders and tlogs, figures, replay and export. Not used by the loop of a flight."""
