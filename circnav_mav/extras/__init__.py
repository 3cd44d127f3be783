"""Extras of the core: each package here can be deleted without touching the flight."""
