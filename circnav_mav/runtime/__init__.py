"""The shell round the pilot: sockets, clock, files, screen."""
