"""Every verb of the ASCII driver on every firmware and every way in which a device can be found, byte by byte."""

import pytest
from virtual_rig import VirtualRig

from labctl.doubles.alicat_variants import FIRMWARES
from labctl.doubles.faults import parse_faults
from labctl.drivers.opening import open_regulator
from labctl.errors import InstrumentError, NoAnswer, ReadBackMismatch
from labctl.links.deadline import Deadline

FOUND = ("", "silent-version", "no-blank", "second-sensor", "streaming", "half-line", "late-once:0.3")
SOURCE = {"10v05": "serial", "10v20": "serial"}
REVISION = {
    "gp": "GP07R100",
    "5v12": "5v12.0-R22",
    "6v21": "6v21.0-R22",
    "7v09": "7v09.0-R22",
    "8v17": "8v17.0-R23",
    "8v30": "8v30.0-R23",
    "9v00": "9v00.0-R24",
    "10v05": "10v05.0-R24",
    "10v20": "10v20.0-R24",
}


@pytest.fixture
def opened():
    """Open a regulator of a firmware, found so; `on` has its double and its time."""
    closers = []

    def make(firmware="10v20", found="", **settings):
        rig = VirtualRig(*([f"regulator={found}"] if found else []), regulator_firmware=firmware, **settings)
        device = open_regulator(rig.config.regulator, rig.config.limits, rig.time, rig.doubles.wires)
        closers.extend([device, rig])
        device.on = rig
        return device

    yield make
    for closer in closers:
        closer.close()


@pytest.mark.parametrize("found", FOUND)
@pytest.mark.parametrize("firmware", FIRMWARES)
def test_every_verb_on_every_firmware(opened, firmware, found):
    device = opened(firmware, found)
    identity = device.identify()
    assert identity.model == "PCD-15PSIG-D"
    assert identity.serial_number == "123456"
    assert identity.firmware == REVISION[firmware]
    assert identity.setpoint_source == SOURCE.get(firmware)
    assert device.read().gauge_psi == pytest.approx(0.0, abs=0.05)
    assert device.write_setpoint(3.9).setpoint_psi == pytest.approx(3.9)
    device.on.time.sleep(6)
    assert device.read().gauge_psi == pytest.approx(3.9, abs=0.05)
    assert device.exhaust().exhausting
    assert device.write_setpoint(0.0).setpoint_psi == 0
    device.on.time.sleep(2)
    reading = device.read()
    assert reading.gauge_psi == pytest.approx(0.0, abs=0.05)
    assert "LCK" not in reading.status
    assert not device.cancel_hold().exhausting


@pytest.mark.parametrize("found", FOUND)
@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_device_is_vented_by_whoever_has_not_identified_it(opened, firmware, found):
    device = opened(firmware, found)
    for _ in range(2):
        try:
            device.write_setpoint(0.0, timeout_s=2.0)
            break
        except InstrumentError:
            continue
    assert device.exhaust(timeout_s=2.0).exhausting


def moved(device):
    """Identified, at 1.0 psi as read; then on its way to 3.0."""
    device.identify()
    device.write_setpoint(1.0)
    device.on.time.sleep(3)
    assert device.read().gauge_psi == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("late_s", [0.25, 0.7, 2.5])
@pytest.mark.parametrize("late", [1, 2])
@pytest.mark.parametrize("firmware", FIRMWARES)
def test_after_a_late_answer_the_next_reading_is_the_present_one(opened, firmware, late, late_s):
    device = opened(firmware)
    moved(device)
    device.on.doubles.inject(parse_faults([f"regulator=late-once:{late_s}"] * late))
    with pytest.raises(NoAnswer):
        device.read(timeout_s=0.2)
    device.on.plant.write_setpoint(3.0)
    for _ in range(40):
        device.on.time.sleep(0.05)
        before_psi = device.on.plant.state().pressure_psi
        try:
            reading = device.read(timeout_s=0.2)
        except InstrumentError:
            continue
        assert before_psi - 0.05 < reading.gauge_psi < device.on.plant.state().pressure_psi + 0.05
    assert reading.gauge_psi == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_device_that_is_always_late_gives_no_reading(opened, firmware):
    device = opened(firmware)
    moved(device)
    device.on.doubles.inject(parse_faults(["regulator=late:0.6"]))
    device.on.plant.write_setpoint(3.0)
    for _ in range(40):
        with pytest.raises(InstrumentError):
            device.read()
    device.on.doubles.inject(parse_faults([]))
    for _ in range(20):
        try:
            assert device.read().gauge_psi == pytest.approx(3.0, abs=0.05)
            break
        except NoAnswer:
            continue
    else:
        pytest.fail("not read again within 10 s")


@pytest.mark.parametrize("interval_ms", [20, 50, 150, 300])
def test_a_device_that_begins_to_stream_is_read_again(opened, interval_ms):
    device = opened()
    device.identify()
    other = Deadline(device.on.time, 1.0)
    device._link.send_unheard(b"ANCS %d\r" % interval_ms, other)
    device._link.send_unheard(b"A@=@\r", other)
    assert device.read(timeout_s=1.0).gauge_psi == pytest.approx(0.0, abs=0.05)


def test_a_ramp_of_the_devices_own_is_named(opened):
    device = opened(found="own-ramp:0.5")
    device.identify()
    with pytest.raises(ReadBackMismatch, match=r"the device ramps its own setpoint \(SR: 0.5 PSIG/s\)"):
        device.write_setpoint(3.9)


def test_a_ramp_of_the_devices_own_on_firmware_that_does_not_tell_it_is_seen(opened):
    device = opened("6v21", found="own-ramp:2")
    device.identify()
    with pytest.raises(ReadBackMismatch, match="the device ramps its own setpoint"):
        device.write_setpoint(3.9)


def test_a_quick_ramp_of_the_devices_own_is_waited_for(opened):
    device = opened(found="own-ramp:20")
    device.identify()
    assert device.write_setpoint(3.9).setpoint_psi == pytest.approx(3.9)


@pytest.mark.parametrize(
    ("found", "firmware", "words"),
    [
        ("stuck-setpoint", "10v20", "it refuses the value"),
        ("stuck-setpoint", "8v30", "its setpoint source is not serial (it does not report it)"),
        ("ignored-setpoint", "10v20", "its setpoint source is analog"),
    ],
)
def test_a_setpoint_that_is_not_taken_is_explained_by_what_was_read(opened, found, firmware, words):
    device = opened(firmware, found)
    device.identify()
    with pytest.raises(ReadBackMismatch) as caught:
        device.write_setpoint(3.9)
    assert words in str(caught.value)
