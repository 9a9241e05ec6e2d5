"""Another program has the ledger's database locked, as a database browser does with changes that are not saved."""

import sqlite3
import subprocess
import sys
import threading
from contextlib import contextmanager

from made_ledger import Notices, a_run, a_trial, check_files_agree, no_notice

from labctl.ledger.ledger import Ledger
from labctl.ledger.writer import LedgerWriter


@contextmanager
def locked(folder, how="IMMEDIATE"):
    """Lock the database from another connection."""
    other = sqlite3.connect(folder / "ledger.sqlite", isolation_level=None)
    other.execute(f"BEGIN {how}")
    try:
        yield
    finally:
        other.execute("ROLLBACK")
        other.close()


def test_a_lock_that_ends_in_time_is_waited_for(tmp_path):
    notices = Notices()
    with LedgerWriter.open(tmp_path / "ledger", notices, patience_s=30.0) as ledger:
        run = ledger.begin_run(a_run())
        began, ended = threading.Event(), threading.Event()

        def browse():
            with locked(tmp_path / "ledger"):
                began.set()
                ended.wait(3.0)

        browser = threading.Thread(target=browse)
        browser.start()
        began.wait(5.0)
        ledger.add_trial(a_trial(run.number))
        browser.join()
        assert ledger.trials(run.number) == (a_trial(run.number),)

    (notice,) = notices.lines
    assert f"{tmp_path / 'ledger' / 'ledger.sqlite'} is locked" in notice
    assert "close it there, or end its transaction; waiting for it, up to 30 s" in notice
    check_files_agree(tmp_path / "ledger")


def test_a_lock_that_stays_costs_no_trial(tmp_path):
    folder, notices = tmp_path / "ledger", Notices()
    with LedgerWriter.open(folder, notices, patience_s=0.0) as ledger:
        run = ledger.begin_run(a_run())
        with locked(folder):
            ledger.add_trial(a_trial(run.number, 1))
            ledger.add_trial(a_trial(run.number, 2))
            with Ledger.open(folder, no_notice) as reader:
                assert [trial.number for trial in reader.trials(run.number)] == [1, 2]
        # The file is free again: what waited goes in with the next row.
        ledger.add_trial(a_trial(run.number, 3))
        check_files_agree(folder)
    assert len([notice for notice in notices.lines if "safe in the journal" in notice]) == 1


def test_a_lock_that_outlives_the_run_costs_no_trial(tmp_path):
    folder, notices = tmp_path / "ledger", Notices()
    with locked_from_the_first_trial(folder, notices) as run:
        pass
    assert (
        "1 rows are safe in the journal beside it, and are put in when the ledger is next written"
        in notices.lines[-1]
    )

    with LedgerWriter.open(folder, notices) as ledger:
        assert ledger.trials(run.number) == (a_trial(run.number),)
    check_files_agree(folder)


@contextmanager
def locked_from_the_first_trial(folder, notices):
    ledger = LedgerWriter.open(folder, notices, patience_s=0.0)
    run = ledger.begin_run(a_run())
    with locked(folder):
        ledger.add_trial(a_trial(run.number))
        ledger.close()
        yield run


def test_what_is_no_lock_is_not_called_one(tmp_path, monkeypatch):
    folder, notices = tmp_path / "ledger", Notices()
    with LedgerWriter.open(folder, notices, patience_s=0.0) as ledger:
        run = ledger.begin_run(a_run())
        with locked(folder):
            ledger.add_trial(a_trial(run.number, 1))

        def full(connection, rows):
            raise sqlite3.OperationalError("database or disk is full")

        monkeypatch.setattr("labctl.ledger.store.appender.insert", full)
    assert "could not be written (database or disk is full)" in notices.lines[-1]
    assert "locked" not in notices.lines[-1]


def test_who_has_it_open_is_named(tmp_path):
    folder, notices = tmp_path / "ledger", Notices()
    browse = (
        "import sqlite3, sys; it = sqlite3.connect(sys.argv[1], isolation_level=None); "
        "it.execute('BEGIN IMMEDIATE'); "
        "print('locked', flush=True); sys.stdin.read()"
    )
    with LedgerWriter.open(folder, notices, patience_s=0.0) as ledger:
        run = ledger.begin_run(a_run())
        with subprocess.Popen(
            [sys.executable, "-c", browse, str(folder / "ledger.sqlite")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        ) as browser:
            browser.stdout.readline()
            ledger.add_trial(a_trial(run.number))
            browser.stdin.close()
    assert f"(process {browser.pid})" in notices.lines[0]


def test_a_ledger_that_is_locked_from_the_start_takes_a_run_all_the_same(tmp_path):
    folder = tmp_path / "ledger"
    with LedgerWriter.open(folder, no_notice):
        pass
    notices = Notices()
    with locked(folder), LedgerWriter.open(folder, notices, patience_s=0.0) as ledger:
        assert ledger.begin_run(a_run()).number == 1
    with Ledger.open(folder, notices) as reader:
        assert reader.run(1).number == 1
    assert "row 1 (the beginning of run 1); put in, when it is next written to" in notices.text
