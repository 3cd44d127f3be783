"""Campaigns: a mission flown thousands of times with varied values, against the bundled vehicle."""
