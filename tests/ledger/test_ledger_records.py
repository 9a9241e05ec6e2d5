import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from made_ledger import ENDED, a_result, a_run, a_trial, an_event, no_notice

from labctl.config.rig import MarkerPoint
from labctl.errors import BadInput, LabError
from labctl.instruments.readings import Identity
from labctl.ledger.ledger import Ledger
from labctl.ledger.records import EventRecord, SafeReadBack, SimulatedHeights
from labctl.ledger.store.record_text import format_record, parse_event, parse_run, parse_trial
from labctl.ledger.store.rows import parse_body, parse_line, row_of
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.windows import Window

STORED = Path(__file__).parent / "stored_rows.jsonl"


def test_what_was_written_comes_back_to_the_last_bit(tmp_path):
    with LedgerWriter.open(tmp_path, no_notice) as writer:
        run = writer.begin_run(a_run())
        trial = a_trial(run.number)
        bare = a_trial(
            run.number, 2, result=None, raw={}, windows=(), outcome="failed", reason="too few markers"
        )
        event = an_event(run.number, "finished", summary={"e_t_mean_percent": 0.1 + 0.2})
        writer.add_trial(trial)
        writer.add_trial(bare)
        writer.add_event(event)

    with Ledger.open(tmp_path, no_notice) as ledger:
        assert ledger.runs() == (run,)
        assert run == a_run(number=1)
        assert ledger.trials(1) == (trial, bare)
        assert ledger.events(1) == (event,)
        (back, _) = ledger.trials(1)
    assert isinstance(back.pressures_psi, tuple)
    assert isinstance(back.windows, tuple)
    assert str(back.levels[0].heights_mm[2]) == "-0.0"


def test_a_run_is_named_by_its_number_or_as_the_last(tmp_path):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        with pytest.raises(BadInput, match="no runs yet"):
            ledger.find("last")
        for protocol in ("five-trial", "relaxation", "layering"):
            ledger.begin_run(a_run(protocol=protocol))

        assert [run.number for run in ledger.runs()] == [1, 2, 3]
        assert ledger.find("2") == ledger.find("0002") == ledger.run(2)
        assert ledger.find("last").protocol == "layering"
        assert ledger.raw_folder(ledger.run(2)) == tmp_path / "raw" / "0002-relaxation"
        with pytest.raises(BadInput, match="no run 4; it has runs 1 to 3"):
            ledger.find("4")
        with pytest.raises(BadInput, match="by its number or 'last'"):
            ledger.find("newest")


def test_events_are_of_a_run_or_of_the_ledger_itself(tmp_path):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())
        of_run, of_ledger = an_event(run.number, "paused"), an_event(None, "restored", rows=[1])
        ledger.add_event(of_ledger)
        ledger.add_event(of_run)

        assert ledger.events(run.number) == (of_run,)
        assert ledger.events(None) == (of_ledger,)


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (float("nan"), r"EventRecord.detail.e_t\[1\] is nan"),
        (float("-inf"), "is -inf"),
        ({3.9: 1}, "the key 3.9"),
        (np.int64(3), "of type int64"),
        (b"bytes", "of type bytes"),
    ],
)
def test_what_json_does_not_hold_exactly_is_refused_and_named(tmp_path, value, named):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())

        with pytest.raises(LabError, match=named):
            ledger.add_event(an_event(run.number, e_t=[1.0, value]))

        assert ledger.events(run.number) == ()
        ledger.add_event(an_event(run.number, e_t=[1.0, np.float64(2.5)]))
        assert ledger.events(run.number)[0].detail == {"e_t": [1.0, 2.5]}


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"e_t_percent": float("nan")}, r"TrialRecord.result.levels\[0\].e_t_percent is nan"),
        ({"frames": np.int64(960)}, r"TrialRecord.result.levels\[0\].frames is of type int64"),
        ({"frames": 960.0}, r"TrialRecord.result.levels\[0\].frames is 960.0, and not a whole number"),
        ({"seen": (960, None)}, r"TrialRecord.result.levels\[0\].seen\[1\] is None"),
    ],
)
def test_a_record_that_could_not_be_read_back_is_not_committed(tmp_path, changes, named):
    """One such row would make every run of the ledger unreadable."""
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())

        with pytest.raises(LabError, match=named):
            ledger.add_trial(a_trial(run.number, result=a_result(**changes)))

        assert ledger.trials(run.number) == ()


def test_records_are_written_as_they_always_were():
    """Byte for byte, checksums and all: ledgers of other versions are read, and theirs read ours."""
    lines = STORED.read_bytes().splitlines()
    parsers = {"run": parse_run, "trial": parse_trial, "event": parse_event}
    for line in lines:
        row = parse_body(parse_line(line))
        record = parsers[row.kind](row.text)
        assert row_of(row.seq, row.at, record).line() == line + b"\n"
    assert len(lines) == 4


def test_what_is_stored_is_read_into_types():
    run, trial, _, _ = (parse_body(parse_line(line)).text for line in STORED.read_bytes().splitlines())

    run, trial = parse_run(run), parse_trial(trial)

    assert run.request.pressures_psi == (2.6, 3.9)
    assert run.identities["regulator"] == Identity("PCD-15PSIG-D", "123456", None, "serial", ("µ",))
    assert run.simulated_heights[0] == SimulatedHeights("sphere", 3.9, (6.5, 0.1 + 0.2, -0.0))
    assert run.points == (MarkerPoint(4, 17.5, 1 / 3),)
    assert trial.windows[0] == Window("baseline", 1 / 3, 5e-324)
    assert trial.levels[0].heights_mm == (1.7976931348623157e308, None, -0.0)
    assert trial.relaxation.time_s == (0.125, 0.375)
    assert trial.safe == SafeReadBack(safe=False, words="NOT SAFE: 0.4 psi")


def test_an_attempt_is_recorded_once_and_for_a_run_that_is_there(tmp_path):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())
        ledger.add_trial(a_trial(run.number, 1, 1))

        with pytest.raises(LabError, match="trial 1, attempt 1, of run 1 is there already"):
            ledger.add_trial(a_trial(run.number, 1, 1, outcome="failed"))
        with pytest.raises(BadInput, match="no run 2"):
            ledger.add_trial(a_trial(2))
        with pytest.raises(BadInput, match="no run 2"):
            ledger.add_event(EventRecord(2, "paused", ENDED))
        with pytest.raises(LabError, match="has no number yet"):
            ledger.begin_run(a_run(number=4))

        ledger.add_trial(a_trial(run.number, 1, 2))
        assert [(each.number, each.attempt) for each in ledger.trials(run.number)] == [(1, 1), (1, 2)]


def test_a_row_that_sqlite_does_not_take_is_taken_back(tmp_path, monkeypatch):
    """It is no damage, and left in the journal it would keep the ledger from ever being opened again."""
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())
        for number, attempt in ((0, 1), (1, 0), (-1, 1), (1 << 70, 1)):
            with pytest.raises(LabError, match="both count from 1"):
                ledger.add_trial(a_trial(run.number, number, attempt))
        monkeypatch.setattr("labctl.ledger.writer.LedgerWriter.run", lambda *_: None)
        with pytest.raises(LabError, match="FOREIGN KEY"):
            ledger.add_event(an_event(run.number + 1))
        ledger.add_event(an_event(run.number))
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        assert len(ledger.events(run.number)) == 1
        assert ledger.trials(run.number) == ()


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE trials SET attempt = 9",
        "DELETE FROM trials",
        "DELETE FROM runs",
        "UPDATE events SET record = '{}'",
        "INSERT OR REPLACE INTO trials (seq, run, trial, attempt, written, written_mono_s, boot, record, checksum) "
        "SELECT seq, run, trial, attempt, written, written_mono_s, boot, '{}', checksum FROM trials",
        "INSERT OR REPLACE INTO trials (seq, run, trial, attempt, written, written_mono_s, boot, record, checksum) "
        "SELECT 99, run, trial, attempt, written, written_mono_s, boot, '{}', checksum FROM trials",
        "INSERT INTO events (seq, written, written_mono_s, boot, record, checksum) VALUES (1, '', 0, '', '{}', '')",
    ],
)
def test_sqlite_itself_refuses_to_change_what_is_there(kept, statement):
    refused = pytest.raises(sqlite3.IntegrityError, match="append-only")
    with closing(sqlite3.connect(kept.sqlite)) as connection, refused:
        connection.execute(statement)


def test_a_trial_without_its_run_is_refused_by_sqlite(kept):
    with closing(sqlite3.connect(kept.sqlite)) as connection:
        connection.execute("PRAGMA foreign_keys = ON")
        with pytest.raises(sqlite3.IntegrityError, match="FOREIGN KEY"):
            connection.execute(
                "INSERT INTO trials (seq, run, trial, attempt, written, written_mono_s, boot, record, checksum) "
                "VALUES (99, 7, 1, 1, '', 0, '', '{}', '')"
            )


def test_a_person_with_sqlite_sees_columns(kept):
    with closing(sqlite3.connect(kept.sqlite)) as connection:
        assert connection.execute("SELECT run, protocol, design_name FROM runs").fetchall() == [
            (1, "five-trial", "known")
        ]
        assert connection.execute("SELECT trial, outcome FROM trials WHERE trial < 3").fetchall() == [
            (1, "good"),
            (2, "good"),
        ]


@pytest.mark.parametrize(
    ("read", "record"), [(parse_run, a_run()), (parse_trial, a_trial(1)), (parse_event, an_event(1))]
)
def test_a_record_of_another_version_is_named_as_such(read, record):
    plain = json.loads(format_record(record))
    for fields in ({**plain, "new_field": 1}, {}):
        with pytest.raises(LabError, match="the version that wrote it"):
            read(json.dumps(fields))
