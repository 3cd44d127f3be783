"""How firmware follows a command: nothing at all for the dead time, then a loop of second order that overshoots."""

import math

Line = tuple[tuple[float, float], ...]
"""Commands on their way: seconds until each arrives and its value. The first has arrived and is in force."""


def pieces(dt: float, longest: float) -> list[float]:
    """A time step cut into equal ones."""
    count = max(1, math.ceil(dt / longest - 1e-9))
    return [dt / count] * count


def through_line(line: Line, command: float, dead_time: float, h: float) -> Line:
    """The line `h` seconds later, with a command put in now; what comes out is the value of its first entry."""
    line = tuple((left - h, value) for left, value in line)
    if not line or line[-1][1] != command:
        line += ((dead_time, command),)
    while len(line) > 1 and line[1][0] < h / 2:
        line = line[1:]
    return line


def second_order(error: float, rate: float, frequency: float, damping: float, h: float) -> float:
    """The rate of change `h` seconds later of a loop that takes `error` to zero; frequency in rad/s."""
    return rate + (frequency**2 * error - 2 * damping * frequency * rate) * h
