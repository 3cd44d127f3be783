"""Texts of figures with their 95 % intervals, for the tables of the benchmarks."""

from collections.abc import Sequence

from circnav_mav.extras.bench.table import interval
from circnav_mav.extras.campaign.figures import wilson
from circnav_mav.runlog.many_flights import median_interval, quantile


def median(values: Sequence[float], form: str = ".2f") -> str:
    """Return a median with its interval, which needs at least six values."""
    if not values:
        return "-"
    low, high = median_interval(sorted(values), len(values))
    between = "" if low is None or high is None else interval(low, high, form)
    return f"{quantile(values, 0.5):{form}}{between}"


def count(number: int, of: int) -> str:
    """Return a number of cases with the interval of their share, in percent."""
    if not of:
        return "-"
    low, high = wilson(number / of, of)
    assert low is not None and high is not None
    return f"{number} of {of} ({100 * low:.0f} to {100 * high:.0f} %)"
