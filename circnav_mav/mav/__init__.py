"""MAVLink without sockets and without a clock: bytes and the time come in as arguments, bytes go out."""
