"""Every fault of a relay board and of a Modbus regulator, under every verb: a right value or an error, in time.

Right is what the doubles' plant says. The doubles are asked byte by byte, in virtual time.
"""

import itertools

import pytest
from virtual_rig import VirtualRig

from labctl.doubles.faults import parse_faults
from labctl.drivers.opening import open_regulator, open_valves
from labctl.errors import InstrumentError, Unproven

FIRMWARES = [
    "bytes-reversed",
    "write-bytes-reversed",
    "no-all-coil",
    "no-multiple-write",
    "single-coils-only",
    "old-firmware",
]
WIRES = ["late:0.03", "late:0.3", "silent", "garbage", "truncated", "wrong-address"]
# A call ends by its deadline, the gap of a frame and the quiet that resynchronises.
MARGIN_S = 0.1


@pytest.fixture
def rig_with():
    made = []

    def make(*faults, **settings):
        made.append(VirtualRig(*faults, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


def outcome(rig, act, within_s):
    """What came of a verb: its value, or its error; it ended in time."""
    begin_s = rig.time.now_s()
    try:
        return act()
    except InstrumentError as error:
        assert type(error) is not InstrumentError
        return error
    finally:
        assert rig.time.now_s() - begin_s <= within_s + MARGIN_S


@pytest.mark.parametrize("channels", [8, 16, 32])
@pytest.mark.parametrize("transport", ["rtu", "tcp"])
@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_board_of_another_firmware_does_what_it_is_told(rig_with, firmware, transport, channels):
    rig = rig_with(f"valves={firmware}", valve_transport=transport, relay_channels=channels)
    board = open_valves(rig.config.valves, rig.time, rig.doubles.wires)
    patterns = [{channels}, {1, channels // 2, channels - 1}, {2, 3}, set(range(1, channels + 1)), set()]
    if firmware == "old-firmware" and channels > 8:
        with pytest.raises(InstrumentError, match="eight channels"):
            board.read()
        return
    assert board.read() == set()
    for on in patterns:
        assert board.write(on) == on
        assert rig.plant.state().coils == on
        assert board.read() == on
        assert board.look(0.2) == on
    assert board.identify().notes


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_board_on_a_bad_wire_is_never_read_wrong(rig_with, firmware, wire):
    """The wire goes bad while a pattern is on, and good again: what was then said and done is right."""
    rig = rig_with(f"valves={firmware}", relay_channels=8)
    board = open_valves(rig.config.valves, rig.time, rig.doubles.wires)
    assert board.write({3, 8}) == {3, 8}
    rig.doubles.inject(parse_faults([f"valves={firmware}", f"valves={wire}"]))
    for verb in (board.read, board.look, board.identify):
        found = outcome(rig, lambda verb=verb: verb(timeout_s=0.5), 0.5)
        if isinstance(found, frozenset):
            assert found == {3, 8}
    for on in ((), {1}, ()):
        found = outcome(rig, lambda on=on: board.write(on, timeout_s=1.5), 1.5)
        assert isinstance(found, InstrumentError) or found == rig.plant.state().coils == set(on)
    rig.doubles.inject(parse_faults([f"valves={firmware}"]))
    for _ in range(3):
        last = outcome(rig, lambda: board.write((), timeout_s=2.0), 2.0)
    assert last == rig.plant.state().coils == frozenset()


SWAPS = ["swapped-words", "swapped-bytes", "unknown-status-bit", "unit-bar"]


@pytest.mark.parametrize("order", ["high-first", "low-first"])
@pytest.mark.parametrize(
    "faults", [combination for n in (1, 2) for combination in itertools.combinations(SWAPS, n)]
)
def test_a_modbus_regulator_that_is_not_as_configured_takes_no_setpoint(rig_with, faults, order):
    """A double that is set to bar is not vouched for by its rig.toml."""

    def configured(text):
        return text.replace('pressure_unit = "psi"\n', f'pressure_unit = "psi"\nword_order = "{order}"\n')

    rig = rig_with(*(f"regulator={fault}" for fault in faults), regulator="alicat-modbus", change=configured)
    rig.time.sleep(1)
    regulator = open_regulator(rig.config.regulator, rig.config.limits, rig.time, rig.doubles.wires)
    fits = order == ("low-first" if "swapped-words" in faults else "high-first")
    usable = fits and not {"swapped-bytes", "unknown-status-bit", "unit-bar"} & set(faults)
    for setpoint_psi in (0.1, 1.2345, 3.9):
        found = outcome(rig, lambda value=setpoint_psi: regulator.write_setpoint(value, 1.0), 1.0)
        if usable:
            assert found.setpoint_psi == pytest.approx(setpoint_psi, abs=0.006)
        else:
            assert isinstance(found, InstrumentError)
            assert rig.plant.state().setpoint_psi == 0
            assert isinstance(found, Unproven) or "unit-bar" not in faults
    outcome(rig, lambda: regulator.write_setpoint(0.0, 1.0), 1.0)
    assert rig.plant.state().setpoint_psi == 0


def test_the_right_order_is_proven_at_each_of_a_thousand_openings(rig_with):
    rig = rig_with(regulator="alicat-modbus")
    rig.time.sleep(1)
    for _ in range(1000):
        opened = open_regulator(rig.config.regulator, rig.config.limits, rig.time, rig.doubles.wires)
        opened.identify(1.0)
        opened.close()
