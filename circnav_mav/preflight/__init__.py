"""Preflight: receives the data of the connected vehicle and its ranging radio, and checks them."""
