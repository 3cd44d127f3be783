"""circnav_mav: circle an unknown target with nothing but a range, over MAVLink.

`from circnav_mav import Guidance, ...` is the public API (see `circnav_mav.api`). It is loaded at
first use: importing its filters is slow, and `circnav --help` does not need them. Extras add
functions to it (`Extension.functions`).
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from circnav_mav.api import Guidance, tune
    from circnav_mav.guidance.estimators.interface import Estimator, EstimatorSettings
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
    from circnav_mav.mav.ranging.driver import Driver, RadioReading
    from circnav_mav.mav.ranging.line_driver import LineDriver

# An installed package contains its folder config/. In a checkout, config/ and sim/ are beside it.
_here = Path(__file__).parent
if not (_here / "config").is_dir() and (_here.parent / "config" / "__init__.py").is_file():
    import_module("circnav_mav.checkout").add_folders(_here.parent)

__version__ = "0.1.0"
__all__ = [
    "Direction",
    "Driver",
    "Estimator",
    "EstimatorSettings",
    "Guidance",
    "LawChoice",
    "LineDriver",
    "Orbit",
    "OwnMotion",
    "RadioReading",
    "RangeEstimate",
    "RangeSample",
    "RelativeMotion",
    "TurnCommand",
    "tune",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        if not name.startswith("_"):
            extension = import_module("circnav_mav.extension")
            for one in extension.extensions():
                if name in one.functions:
                    return extension.load(one.functions[name])
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    modules = (
        import_module(f"circnav_mav.{one}")
        for one in ("mav.ranging.line_driver", "guidance.types", "api")
    )
    return next(getattr(module, name) for module in modules if hasattr(module, name))


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
