"""One small module per vehicle kind, behind one contract (`interface`)."""
