"""An emulated MAVLink vehicle with autopilot and ranging radio, for tests and for the quickstart.

It shares neither code nor sign convention with the product: it uses NED, headings and turn rates
clockwise from above.
"""
