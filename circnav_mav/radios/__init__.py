"""Drivers of ranging radios: bytes in, readings out, without I/O. docs/radios.md tells how to write another."""
