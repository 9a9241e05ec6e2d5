from dataclasses import replace
from datetime import datetime, timedelta

import pytest
from made_ledger import Notices, a_run, a_trial, no_notice

from labctl.ledger import moment
from labctl.ledger.ledger import Ledger
from labctl.ledger.moment import Moment, now, seconds_between, set_back_s
from labctl.ledger.writer import LedgerWriter

NOON = Moment("2026-03-01T12:00:00.000000+01:00", 500.0, "boot-a")


class SetClock:
    """A wall clock that the test sets, and a monotonic one that goes on whatever it does."""

    def __init__(self):
        self.moment = NOON

    def __call__(self):
        return self.moment

    def pass_s(self, seconds, wall_s=None):
        wall = datetime.fromisoformat(self.moment.wall) + timedelta(
            seconds=seconds if wall_s is None else wall_s
        )
        self.moment = replace(
            self.moment, wall=wall.isoformat(timespec="microseconds"), mono_s=self.moment.mono_s + seconds
        )


def test_now_has_a_zone_and_both_clocks_go_on():
    first, second = now(), now()

    assert datetime.fromisoformat(first.wall).tzinfo is not None
    assert "." in first.wall
    assert first.boot == second.boot
    assert 0 <= seconds_between(first, second) < 1
    assert set_back_s(first, second) == 0


def test_without_linux_moments_compare_within_one_process_only(monkeypatch, tmp_path):
    monkeypatch.setattr(moment, "_BOOT_ID", tmp_path / "nowhere")
    moment.boot_id.cache_clear()
    try:
        assert now().boot == now().boot
        assert now().boot.startswith("process-")
    finally:
        moment.boot_id.cache_clear()


@pytest.mark.parametrize(
    ("later", "back_s"),
    [
        (Moment("2026-03-01T12:00:10.000000+01:00", 510.0, "boot-a"), 0),
        (Moment("2026-03-01T11:00:10.000000+00:00", 510.0, "boot-a"), 0),
        (Moment("2026-03-01T12:00:09.200000+01:00", 510.0, "boot-a"), 0),
        (Moment("2026-03-01T11:00:10.000000+01:00", 510.0, "boot-a"), 3600),
        (Moment("2026-03-01T12:30:00.000000+01:00", 500.0 + 5400, "boot-a"), 3600),
        (Moment("2026-03-01T13:00:00.000000+01:00", 3.0, "boot-b"), 0),
        (Moment("2026-03-01T11:00:00.000000+01:00", 3.0, "boot-b"), 3600),
    ],
)
def test_by_how_much_a_clock_was_set_back(later, back_s):
    assert set_back_s(NOON, later) == pytest.approx(back_s)


def test_a_clock_set_back_is_an_event_and_changes_no_order(tmp_path):
    clock, notices = SetClock(), Notices()
    with LedgerWriter.open(tmp_path, notices, clock) as ledger:
        run = ledger.begin_run(a_run())
        clock.pass_s(60)
        ledger.add_trial(a_trial(run.number, 1))
        clock.pass_s(60, wall_s=60 - 7200)
        ledger.add_trial(a_trial(run.number, 2))
        clock.pass_s(60)
        ledger.add_trial(a_trial(run.number, 3))

    with Ledger.open(tmp_path, no_notice) as ledger:
        assert [trial.number for trial in ledger.trials(run.number)] == [1, 2, 3]
        (event,) = ledger.events(run.number)
    assert event.kind == "clock-set-back"
    assert event.detail == {
        "before": "2026-03-01T12:01:00.000000+01:00",
        "after": "2026-03-01T10:02:00.000000+01:00",
        "by_s": 7200.0,
    }
    assert "set back by 7200 s" in notices.text


def test_a_run_begins_on_a_clock_that_was_set_back_since_the_last(tmp_path):
    clock, notices = SetClock(), Notices()
    with LedgerWriter.open(tmp_path, notices, clock) as ledger:
        ledger.begin_run(a_run())
        clock.pass_s(60, wall_s=60 - 3600)
        run = ledger.begin_run(a_run())
        ledger.add_trial(a_trial(run.number, 1))

    with Ledger.open(tmp_path, no_notice) as ledger:
        assert [each.number for each in ledger.runs()] == [1, 2]
        assert len(ledger.trials(2)) == 1
        (event,) = ledger.events(None)
    assert (event.kind, event.detail["by_s"]) == ("clock-set-back", 3600.0)
    assert notices.text.count("set back by 3600 s") == 1
