"""Readers of logs: one file per format; `table` picks the reader by the content of a file."""
