"""Many flights at once on a planar point mass: the worlds, the sensors and the loop of the benchmark."""
