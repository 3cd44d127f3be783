"""One small module per vehicle: which messages it obeys, which it ignores, and what it does when they stop."""
