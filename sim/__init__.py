"""An emulated MAVLink vehicle with autopilot and ranging radio, for tests and for the quickstart.

It shares no code with the product, and not its sign convention: NED, headings and turn rates clockwise from above.
"""
