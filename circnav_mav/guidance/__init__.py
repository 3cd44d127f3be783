"""Pure guidance: SI units, radians, the paper's frame (x right, y up, counter-clockwise positive).

No I/O, no clock, no MAVLink. Source of the equations cited here as "the paper": Y. Cao, J. Muse, D.
Casbeer, D. Kingston, "Circumnavigation of an Unknown Target Using UAVs with Range and Range Rate
Measurements".
"""
