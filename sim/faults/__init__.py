"""A link that is broken on purpose, between an application and a vehicle: seeded, in both directions.

In lockstep it is an object (`FaultLink`), over UDP a program (`python -m circnav_sim.faults`). It knows bytes
and, where a fault speaks MAVLink, frames; it knows neither the application nor the vehicle.
"""

from .link import DOWN, UP, FaultLink
from .pipe import CLEAN, Impairment

__all__ = ["CLEAN", "DOWN", "UP", "FaultLink", "Impairment"]
