"""How vehicles move: each airframe turns a body, a demand and a time step into the next body."""
