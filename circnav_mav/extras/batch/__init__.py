"""Many flights at once with a planar point mass: worlds, radios and the closed loop of benchmark and campaigns.

Arrays have a last axis B over flights. SI, radians, the paper's frame (x east, y north, counter-clockwise).
"""
