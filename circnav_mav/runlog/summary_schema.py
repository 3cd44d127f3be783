"""What summary.json and manifest.json of a run may hold: whoever reads them gets what is as it should be, and what is
missing or of another kind is unknown."""

from typing import Annotated, Any, Self

from pydantic import BaseModel, Field, TypeAdapter, ValidationError, model_validator

MOST = 10**15
"""No number of a run is as large: counts, metres, and seconds are smaller."""
YEAR_2100_US = 4_102_444_800_000_000
Text = Annotated[str, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Number = Annotated[float, Field(strict=True, gt=-MOST, lt=MOST)]
Length = Annotated[float, Field(strict=True, gt=0, lt=MOST)]
Count = Annotated[int, Field(strict=True, ge=0, lt=MOST)]
Moment = Annotated[int, Field(strict=True, gt=0, lt=YEAR_2100_US)]


class Figures(BaseModel):
    """What was flown, of the last third. Mean and RMS error are known together."""

    settled_s: Number | None
    radius_mean_m: Number | None
    radius_rms_error_m: Number | None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.radius_mean_m is None) != (self.radius_rms_error_m is None):
            raise ValueError("mean and RMS error are known together")
        return self


class TrueFigures(Figures):
    """The same by the simulator's truth."""

    direction: Text | None
    closest_approach_m: Number


class Circle(Figures):
    """The figures of the circle belong together: all or none."""

    desired_radius_m: Length
    direction: Text
    direction_commanded: Text | None
    engaged_s: Number | None
    flown_s: Number
    truth: TrueFigures | None


class CircleFlown(Figures):
    """One of several circles, in the order flown."""

    desired_radius_m: Length
    begun_s: Number


class SurveyedPlace(BaseModel):
    """Where the target was found to be. What moves has a course."""

    latitude_deg: Number
    longitude_deg: Number
    altitude_m: Number | None
    sigma_m: Number
    time_s: Number
    moves: Flag
    speed_mps: Number
    course_deg: Number | None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.moves and self.course_deg is None:
            raise ValueError("what moves has a course")
        return self


class PositionsSent(BaseModel):
    """What the hand-back has sent."""

    sent: Count
    accepted: Count
    ended: Text


class Alarm(BaseModel):
    """What the GPS watch has said."""

    time_s: Number
    text: Text


def _table(kinds: dict[Any, str]) -> dict[str, TypeAdapter[Any]]:
    return {key: TypeAdapter(kind) for kind, keys in kinds.items() for key in keys.split()}


SUMMARY = _table({
    Text: "mission voice outcome reason version",
    Text | None: "firmware recording_problem",
    Count: "samples_accepted setpoints_sent law_changes",
    dict[str, Count]: "samples_rejected frames_refused",
    Moment: "epoch_us",
    Number: "steered_s",
    Number | None: "height_min_m height_max_m turn_std_deg_s turn_at_limit turn_variation_rad_s2 turn_gain "
                   "turn_delay_s gain_share clock_speed",
    Flag | None: "turn_limit_cycle",
    SurveyedPlace | None: "place",
    PositionsSent | None: "handback",
    list[Alarm]: "gps_watch",
    list[CircleFlown]: "circles",
    list[Number]: "circles_wanted_m",
})  # fmt: skip
MANIFEST = _table({
    Text: "mission voice",
    Text | None: "outcome reason",
    Moment: "epoch_us",
    dict[Text, Any]: "seeds versions",
    dict[Text, Any] | None: "autopilot",
    Count | None: "exit",
})  # fmt: skip


def known_manifest(table: Any) -> dict[str, Any]:
    """What a manifest.json says that can be believed."""
    return _known(table, MANIFEST)


def known_summary(table: Any) -> dict[str, Any]:
    """What a summary.json says that can be believed."""
    try:
        circle = Circle.model_validate(table).model_dump()
    except ValidationError:
        circle = {}
    return _known(table, SUMMARY) | circle


def _known(table: Any, kinds: dict[str, TypeAdapter[Any]]) -> dict[str, Any]:
    known = table if isinstance(table, dict) else {}
    return {key: known[key] for key, kind in kinds.items() if key in known and _fits(kind, known[key])}


def _fits(kind: TypeAdapter[Any], value: Any) -> bool:
    try:
        kind.validate_python(value)
    except ValidationError:
        return False
    return True
