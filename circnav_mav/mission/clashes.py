"""Invalid combinations of keys that are valid by themselves."""

from collections.abc import Iterator

from circnav_mav.guidance.estimators.table import ESTIMATORS
from circnav_mav.guidance.laws import LAWS
from circnav_mav.mav.ranging.driver import split_driver
from circnav_mav.mission.mission import SIM, Mission
from circnav_mav.mission.schema import MissionFile


def clashes(mission: Mission) -> Iterator[str]:
    """Yield a line for each combination of keys that cannot be flown."""
    file = mission.file
    yield from _of_endpoints(file)
    yield from _of_range_rate(file)
    yield from _of_vehicle(mission)
    yield from _of_pairs(file)
    yield from _of_own_code(file)


def _of_endpoints(file: MissionFile) -> Iterator[str]:
    ranging = file.ranging
    if file.link.endpoint == SIM and file.sim is None:
        yield (
            f'link.endpoint: is "{SIM}": add a [sim] table that describes the bundled vehicle, or'
            " set the endpoint of your vehicle"
        )
    if ranging.endpoint == SIM and file.link.endpoint != SIM:
        yield (
            f'ranging.endpoint: is "{SIM}", but the vehicle is not the bundled one: --set'
            " ranging.endpoint=URL"
        )
    if ranging.endpoint == file.link.endpoint and ranging.endpoint.startswith(
        ("udpin:", "udp:", "serial:")
    ):
        remedy = "omit ranging.endpoint if ranges arrive on that link"
        yield f'ranging.endpoint: is "{ranging.endpoint}" as link.endpoint: {remedy}'
    if split_driver(ranging.endpoint or "")[0] and ranging.message != "ranging_beacon":
        yield (
            f'ranging.message: is "{ranging.message}": set "ranging_beacon", which drivers produce'
        )
    if file.signing and file.signing.accept_unsigned == "ranging" and ranging.endpoint is None:
        yield 'signing.accept_unsigned: is "ranging": set ranging.endpoint, too'


def _of_range_rate(file: MissionFile) -> Iterator[str]:
    ranging = file.ranging
    if ranging.rate_name is not None and ranging.message != "named_value_float":
        yield f'ranging.rate_name: needs message = "named_value_float", not "{ranging.message}"'
    if ranging.rate_name == ranging.name:
        yield f'ranging.rate_name: is "{ranging.name}" as ranging.name: give the rate another name'
    if file.guidance.estimator == "measured" and ranging.rate_name is None:
        yield (
            'guidance.estimator: is "measured": set ranging.rate_name, the name of the measured'
            " range rate"
        )


def _of_vehicle(mission: Mission) -> Iterator[str]:
    vehicle = mission.file.vehicle
    if vehicle.max_bank_deg is None and mission.by_attitude:
        yield "vehicle.max_bank_deg: missing, the tilt limit of a copter flown by attitude: add it"
    elif vehicle.max_bank_deg is None and any(row.fixed_wing for row in mission.vehicles):
        yield f"vehicle.max_bank_deg: missing, a {vehicle.kind} turns by banking: add its limit"
    elif vehicle.max_bank_deg is None and vehicle.max_turn_rate_deg_s is None:
        yield "vehicle.max_turn_rate_deg_s: missing, add it"


def _of_pairs(file: MissionFile) -> Iterator[str]:
    ways = ("height_above_target_m", "target_altitude_m", "target_above_home_m")
    given = [f"orbit.{way}" for way in ways if getattr(file.orbit, way) is not None]
    if len(given) > 1:
        yield f"{' and '.join(given)}: only one of them may be given: delete the other keys"
    # With the bounds in the wrong order, a flight would end at once.
    for quantity in ("range_m", "altitude_m"):
        low, high = (getattr(file.bounds, f"{side}_{quantity}") for side in ("min", "max"))
        if low is not None and high is not None and low >= high:
            most = f"bounds.max_{quantity} = {high:g}"
            yield (
                f"bounds.min_{quantity}: {low:g} is not below {most}: lower the first, or raise the"
                " second"
            )


def _of_own_code(file: MissionFile) -> Iterator[str]:
    guidance = file.guidance
    if file.link.endpoint == SIM or guidance.own_code_on_vehicle:
        return
    for key, name, table in (
        ("law", guidance.law, LAWS),
        ("estimator", guidance.estimator, ESTIMATORS),
    ):
        if name is not None and name not in table:
            yield (
                f"guidance.{key}: {name!r} is code of your own: to let it steer a vehicle, set"
                " guidance.own_code_on_vehicle = true"
            )
