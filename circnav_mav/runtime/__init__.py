"""Environment of the pilot: sockets, clock, files and screen."""
