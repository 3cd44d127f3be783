"""MAVLink without sockets and without a clock: received bytes and the time are arguments, bytes to
send are results."""
