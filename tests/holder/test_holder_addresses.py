"""What a rig is found by."""

from dataclasses import replace

import pytest

from labctl.config.load import rig_from_text
from labctl.holder.addresses import addresses_of

RIG = """
name = "bench"
[regulator]
driver = "alicat-ascii"
model = "PCD"
port = "/dev/ttyNOSUCH0"
pressure_unit = "psi"
[valves]
driver = "waveshare-relay"
transport = "tcp"
host = "LOCALHOST"
tcp_port = 502
device_id = 3
channels = 8
[markers]
driver = "phasespace"
host = "127.0.0.1"
frequency_hz = 240
up = "+z"
points = [{id=0,x=10,y=70}, {id=1,x=130,y=70}, {id=2,x=70,y=10}, {id=3,x=70,y=130}]
"""


@pytest.fixture
def config():
    return rig_from_text(RIG, "rig.toml")


def test_a_port_counts_by_its_own_name_and_by_the_device_behind_it(config, tmp_path):
    device, link = tmp_path / "ttyUSB7", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    by_link = addresses_of(replace(config.regulator, port=str(link)), config.valves)
    by_device = addresses_of(replace(config.regulator, port=str(device)), config.valves)

    assert set(by_link) & set(by_device) == {f"port {device}", "tcp 127.0.0.1:502#3"}
    assert f"port {link}" in by_link

    link.unlink()
    link.symlink_to(tmp_path / "ttyUSB8")
    assert f"port {link}" in set(by_link) & set(
        addresses_of(replace(config.regulator, port=str(link)), config.valves)
    )


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "LocalHost."])
def test_a_host_counts_by_what_it_means(config, host):
    valves = replace(config.valves, host=host)
    assert "tcp 127.0.0.1:502#3" in addresses_of(config.regulator, valves)


def test_boards_behind_one_gateway_are_of_two_rigs(config):
    other = addresses_of(
        replace(config.regulator, port="/dev/ttyNOSUCH1"), replace(config.valves, device_id=4)
    )
    assert not set(other) & set(addresses_of(config.regulator, config.valves))


def test_a_serial_port_of_the_network_is_a_host(config):
    regulator = replace(config.regulator, port="socket://Box.lab:4001")
    assert "tcp box.lab:4001" in addresses_of(regulator, config.valves)
