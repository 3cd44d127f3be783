"""Many flights at once on a planar point mass: worlds, radios and the closed loop of the benchmark and of campaigns.

Arrays have a last axis B over flights. SI, radians, the paper's frame (x east, y north, counter-clockwise).
"""
