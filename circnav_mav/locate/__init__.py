"""Where the target is on the map, from the positions that the vehicle reports and the ranges. Nothing that steers may
import this room: see the contract "Positions never steer" in pyproject.toml."""
