"""Names of the parameter rules, against the parameters that each firmware version has."""

import tomllib
from pathlib import Path

import pytest

from circnav_mav.mav.autopilots.table import AUTOPILOTS

FILE = Path(__file__).with_name("parameter_versions.toml")
FIRMWARE = {
    kind: {name: versions.split() for name, versions in table.items()}
    for kind, table in tomllib.loads(FILE.read_text()).items()
}
VERSIONS = {"ardupilot": ["4.4", "4.5", "4.6", "4.7"], "px4": ["1.15", "1.16", "1.17", "main"]}
VEHICLES = pytest.mark.parametrize("key", AUTOPILOTS, ids=" ".join)


def of_firmware(key):
    """Return the parameters of the vehicle's firmware, and all versions of the firmware."""
    autopilot, kind = key
    return FIRMWARE[f"{autopilot} {kind.split()[0]}"], VERSIONS[autopilot]


def versions_of(name, versions):
    """Return the versions that a name of a rule is for."""
    first = versions.index(name.since) if name.since else 0
    last = versions.index(name.until) if name.until else len(versions) - 1
    return versions[first : last + 1]


@VEHICLES
def test_parameter_rule_states_firmware_versions_of_each_name(key):
    found, versions = of_firmware(key)
    for rule in AUTOPILOTS[key].parameters:
        assert {name.name: versions_of(name, versions) for name in rule.names} == {
            name.name: found[name.name] for name in rule.names
        }
        assert all(found[name] == versions for name in rule.also)


@VEHICLES
def test_parameter_rule_has_one_name_in_each_firmware_version(key):
    found, versions = of_firmware(key)
    for rule in AUTOPILOTS[key].parameters:
        for version in versions:
            names = [name.name for name in rule.names if version in found[name.name]]
            assert len(names) == 1 or (rule.optional and not names), (version, rule.names)


def test_each_listed_parameter_has_a_rule():
    named = {kind: set() for kind in FIRMWARE}
    for (autopilot, kind), vehicle in AUTOPILOTS.items():
        names = {name for rule in vehicle.parameters for name in rule.requested}
        named[f"{autopilot} {kind.split()[0]}"] |= names
    assert named == {kind: set(table) for kind, table in FIRMWARE.items()}
