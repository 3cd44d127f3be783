"""A deliberately impaired link between an application and a vehicle: seeded, in both directions.

In lockstep it is an object (`FaultLink`), over UDP a program (`python -m tests.tools.fault_link`).
It handles bytes, parses MAVLink frames only if a fault needs them, and works with any application
and vehicle.
"""

from .link import DOWN, UP, FaultLink
from .pipe import CLEAN, Impairment

__all__ = ["CLEAN", "DOWN", "UP", "FaultLink", "Impairment"]
