"""One module per vehicle: the messages that its autopilot obeys or ignores, and its reaction when
setpoints stop."""
