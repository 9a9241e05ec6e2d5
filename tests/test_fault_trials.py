"""A few of the thousands of `make bench-faults`, each with its own seed."""

import logging

import pytest
from fault_trials.fuzz_drivers import SUBJECTS, fuzz
from fault_trials.over_pressure import STATES, over_pressure
from fault_trials.unplugged import LINKS, Breaks


@pytest.fixture
def quiet():
    """pymodbus reports each spoilt frame, and a report takes as long as the frame."""
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    yield
    logging.getLogger("pymodbus").setLevel(logging.NOTSET)


@pytest.mark.parametrize("driver", SUBJECTS)
def test_a_spoilt_reply_is_an_error_or_one_that_nobody_can_tell(driver, quiet):
    tally = fuzz(driver, seed=6, frames=700)

    assert tally.wrong == []
    assert tally.right > tally.calls / 10
    assert tally.errors
    # A checksum of 16 bits misses none of these in 700; a protocol without one does.
    assert (tally.undetectable > 0) == (driver in ("alicat-ascii", "waveshare tcp"))


@pytest.mark.parametrize("link", LINKS)
def test_a_link_that_breaks_in_a_hold_comes_back_and_energises_nothing(link):
    tally = Breaks(link, seed=3).run(2)

    assert tally.wrong == []
    assert len(tally.back_s) == 2


def test_over_pressure_is_vented_within_two_ticks_of_its_first_reading():
    tallies = over_pressure(seed=5, injections=16)

    assert [tally.wrong for tally in tallies] == [[]] * len(STATES)
    assert sum(tally.injections for tally in tallies) == 16
    assert sum(len(tally.after_reading_s) for tally in tallies) > 6
