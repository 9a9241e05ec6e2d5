"""Every driver on every dirty wire: the truth or a named error, by the deadline (docs/reference/wire-faults.md)."""

from functools import cache
from pathlib import Path

import pytest
from wire_matrix import DRIVERS, FAULTS, OF_MARKERS, Bench, Cell, in_words, outcomes_of, tables

PAGE = Path(__file__).parents[1] / "docs/reference/wire-faults.md"
outcomes_once = cache(outcomes_of)

ROWS = [
    (driver, fault)
    for driver, (instrument, _, _) in DRIVERS.items()
    for fault in FAULTS
    if instrument != "markers" or fault in OF_MARKERS
]


@pytest.mark.parametrize(("driver", "fault"), ROWS)
def test_a_value_is_the_truth_or_an_error_says_its_kind_in_time(driver, fault):
    for verb in DRIVERS[driver][2]:
        for from_start in (False, True):
            outcomes_once(Cell(driver, fault, verb, from_start))


def test_the_page_shows_what_the_matrix_gives():
    assert tables(lambda cell: in_words(outcomes_once(cell))) in PAGE.read_text()


DROPPED = {
    "echo of every byte": "sends back every request",
    "0x00 0xFF before replies": "0xFF",
    "0x00 0xFF between replies": "0xFF",
    "0x00 0xFF after replies": "0xFF",
    "NUL after CR": r"NUL|0x00",
    "CR LF": r"CR LF|0x0A",
    "blank lines": r"blank lines|0x0D",
}


@pytest.mark.parametrize("fault", DROPPED)
@pytest.mark.parametrize("driver", ["alicat-ascii", "alicat-modbus", "waveshare-relay on RTU"])
def test_what_is_dropped_is_right_at_once_and_named(driver, fault):
    for verb in DRIVERS[driver][2]:
        for from_start in (False, True):
            assert set(outcomes_once(Cell(driver, fault, verb, from_start))) == {"right"}
    bench = Bench(driver)
    try:
        bench.break_wire(fault)
        bench.open()
        bench.device.identify()
        bench.time.sleep(0.1)
        notes = "; ".join(bench.device.identify().notes)
        assert any(words in notes for words in DROPPED[fault].split("|")), notes
    finally:
        bench.close()
