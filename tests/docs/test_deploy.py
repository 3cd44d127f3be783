"""Files of deploy/: systemd unit and container."""

import json
import re
from configparser import ConfigParser

from tests.process import ROOT


def test_systemd_unit_waits_for_network_and_vehicle():
    unit = ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read(ROOT / "deploy" / "circnav.service")
    for key in ("After", "Wants"):
        assert unit["Unit"][key] == "network-online.target"
    service = unit["Service"]
    assert service["RestartForceExitStatus"] == "3"
    assert service["SupplementaryGroups"] == "dialout"
    assert service["ReadWritePaths"] == service["WorkingDirectory"]
    assert service["NoNewPrivileges"] == "yes" and service["ProtectSystem"] == "strict"


def test_container_has_group_and_devices_of_serial_ports():
    text = (ROOT / "deploy" / "Containerfile").read_text()
    assert "--groups dialout circnav" in text
    label = re.search(r"^LABEL permissions='(.*)'$", text, re.MULTILINE)
    host = json.loads(label[1])["HostConfig"]
    assert host["GroupAdd"] == ["dialout"]
    assert "/dev:/dev:rw" in host["Binds"]
    assert {"c 166:* rmw", "c 188:* rmw", "c 204:* rmw"} < {*host["DeviceCgroupRules"]}
