"""Dynamics of the vehicles. Each airframe computes the next body from a body, a demand and a time
step."""
