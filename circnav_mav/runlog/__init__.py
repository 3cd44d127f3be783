"""Recorded flights: reading run folders and tlogs, figures and replay. Not used by the loop of a
flight."""
