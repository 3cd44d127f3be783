"""Environment of `Pilot`: sockets, clock, files and screen."""
