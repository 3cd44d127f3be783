"""An independent MAVLink vehicle: what the autopilot and the ranging radio do, for tests and for the quickstart.

It shares no code with the product, not even a sign: NED, headings and turn rates clockwise seen from above.
"""
