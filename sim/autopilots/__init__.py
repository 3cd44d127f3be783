"""One module per vehicle: the messages that it obeys or ignores, and its reaction when they
stop."""
