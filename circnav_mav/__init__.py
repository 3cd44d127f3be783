"""circnav_mav: circle an unknown target with nothing but a range, over MAVLink.

`from circnav_mav import Guidance, ...` is the public API (see `circnav_mav.api`). It is loaded at
first use: importing its filters is slow, and `circnav --help` does not need them.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from circnav_mav.api import Guidance, tune
    from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings, Fused
    from circnav_mav.guidance.step import LawChoice
    from circnav_mav.guidance.types import (
        Direction,
        Orbit,
        OwnMotion,
        RangeEstimate,
        RangeSample,
        RelativeMotion,
        TurnCommand,
    )

__version__ = "0.1.0"
__all__ = [
    "Direction",
    "Estimator",
    "EstimatorSettings",
    "Fused",
    "Guidance",
    "LawChoice",
    "Orbit",
    "OwnMotion",
    "RangeEstimate",
    "RangeSample",
    "RelativeMotion",
    "TurnCommand",
    "tune",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from circnav_mav import api
    from circnav_mav.guidance import types

    return getattr(api, name, None) or getattr(types, name)


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
