"""A fleet on one circle: its law, its carrier and its commands."""
