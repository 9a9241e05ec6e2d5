import random
import shutil
import sqlite3
from contextlib import closing

import pytest
from made_ledger import Notices, a_run, a_trial, changed_bytes, check_files_agree, no_notice

from labctl.errors import BadInput, LabError
from labctl.ledger.ledger import Ledger
from labctl.ledger.writer import LedgerWriter


@pytest.fixture
def killed(pristine, tmp_path):
    """A ledger whose writer died: its latest rows are in SQLite's write-ahead log only."""

    def copy(name):
        folder = tmp_path / str(name)
        shutil.copytree(pristine.folder, folder)
        with LedgerWriter.open(folder, no_notice) as writer:
            writer.add_trial(a_trial(1, 1, 2))
            left = tmp_path / f"{name}-left"
            shutil.copytree(folder, left)
            trials = writer.trials(1)
        return type(pristine)(left, pristine.run, trials)

    return copy


def test_sqlite_cut_to_any_length_loses_nothing(copy_kept):
    size = copy_kept("whole").sqlite.stat().st_size
    for length in [0, 1, 15, 16, 99, 100, 4095, *range(4096, size, 4096), size - 1]:
        kept, notices = copy_kept(length), Notices()
        with kept.sqlite.open("r+b") as file:
            file.truncate(length)

        with Ledger.open(kept.folder, notices) as reader:
            kept.check(reader)
        assert kept.sqlite.stat().st_size == length, "opening to read changes nothing"
        assert "ledger.sqlite is" in notices.text
        kept.check_all_there(notices)

        (aside,) = kept.folder.glob("ledger.sqlite.damaged-*")
        assert aside.stat().st_size == length


@pytest.mark.parametrize("rubbish", [b"\0", b"\xff", b"random"])
def test_any_page_of_sqlite_overwritten_loses_nothing(copy_kept, rubbish):
    pages = copy_kept("whole").sqlite.stat().st_size // 4096
    for page in range(pages):
        kept, notices = copy_kept(page), Notices()
        with changed_bytes(kept.sqlite) as data:
            new = random.Random(page).randbytes(4096) if rubbish == b"random" else rubbish * 4096
            data[page * 4096 : (page + 1) * 4096] = new

        kept.check_all_there(notices)

        assert "built again" in notices.text


def test_a_byte_changed_inside_a_record_in_sqlite_is_found(kept, notices):
    with changed_bytes(kept.sqlite) as data:
        data[data.index(b'"e_t_percent":17.1') + 14] = ord("2")

    kept.check_all_there(notices)

    assert "does not match its checksum" in notices.text


def test_a_missing_sqlite_is_built_again_and_that_is_an_event(kept, notices):
    kept.sqlite.unlink()

    kept.check_all_there(notices)

    with Ledger.open(kept.folder, no_notice) as ledger:
        (event,) = ledger.events(None)
    assert event.kind == "restored"
    assert event.detail == {"rows": 13, "first": 1, "last": 13, "sqlite": "is missing"}


@pytest.mark.parametrize("left", [0, 32, 56, 4000, None])
def test_a_write_ahead_log_cut_short_loses_nothing(killed, notices, left):
    kept = killed("a")
    wal = kept.folder / "ledger.sqlite-wal"
    whole = wal.stat().st_size
    with wal.open("r+b") as file:
        file.truncate(whole - 1 if left is None else left)

    with Ledger.open(kept.folder, notices) as reader:
        kept.check(reader)
    assert "lacks what ledger.journal has: row 14 (trial 1, attempt 2, of run 1)" in notices.text
    kept.check_all_there(notices)


def test_a_writer_that_died_leaves_nothing_to_report(killed):
    kept = killed("a")
    before = {path.name: path.read_bytes() for path in kept.folder.glob("ledger.*")}

    with Ledger.open(kept.folder, no_notice) as reader:
        kept.check(reader)

    assert {path.name: path.read_bytes() for path in kept.folder.glob("ledger.*")} == before
    kept.check_all_there(no_notice)


def test_the_journal_cut_to_any_length_loses_nothing(copy_kept):
    size = copy_kept("whole").journal.stat().st_size
    for length in [0, 1, 60, 69, *range(100, size, 977), size - 1]:
        kept, notices = copy_kept(length), Notices()
        with kept.journal.open("r+b") as file:
            file.truncate(length)

        kept.check_all_there(notices)

        assert "ledger.journal" in notices.text
        with Ledger.open(kept.folder, no_notice) as ledger:
            assert ledger.events(None) == ()


def test_bytes_flipped_in_the_journal_lose_nothing(copy_kept):
    size = copy_kept("whole").journal.stat().st_size
    chance = random.Random(5)
    for at in [0, 11, 68, 69, 70, size - 1, *(chance.randrange(size) for _ in range(20))]:
        kept, notices = copy_kept(at), Notices()
        with changed_bytes(kept.journal) as data:
            data[at] ^= 1 << chance.randrange(8)
            damaged = bytes(data)

        kept.check_all_there(notices)

        if at < size - 1:
            (aside,) = kept.folder.glob("ledger.journal.damaged-*")
            assert aside.read_bytes() == damaged


def test_an_end_of_line_that_is_damaged_costs_no_row(kept, notices):
    with changed_bytes(kept.journal) as data:
        at = data.index(b"\n", data.index(b'"kind":"trial","run":1,"trial":2'))
        data[at] = ord("?")
        # Rubbish over the beginning of the next row costs that one only.
        at = data.index(b"\n", data.index(b'"kind":"trial","run":1,"trial":4'))
        data[at : at + 30] = b"?" * 30
    kept.sqlite.unlink()

    with LedgerWriter.open(kept.folder, notices) as ledger:
        assert ledger.trials(1) == kept.trials
        (lost,) = [event for event in ledger.events(None) if event.kind == "lost"]
    assert lost.detail["rows"] == {"9": "an event of run 1"}


def test_a_missing_journal_is_written_again(kept, notices):
    kept.journal.unlink()

    kept.check_all_there(notices)

    assert "ledger.journal is missing: written again" in notices.text


def test_an_unfinished_append_is_set_aside(kept, notices):
    torn = b'{"sha256":"0123456789abcdef","seq":14,"kind":"trial","run":1,"trial":7,'
    with kept.journal.open("ab") as file:
        file.write(torn)

    kept.check_all_there(notices)

    (aside,) = kept.folder.glob("ledger.journal.torn-*")
    assert aside.read_bytes() == torn
    assert "not finished: set aside" in notices.text


def test_rows_that_only_the_journal_has_are_put_in(kept, notices):
    """As after a kill between the journal and SQLite."""
    with LedgerWriter.open(kept.folder, no_notice) as writer:
        before = kept.sqlite.read_bytes()
        writer.add_trial(a_trial(1, 6, 2))
        trials = writer.trials(1)
    kept.sqlite.write_bytes(before)

    with Ledger.open(kept.folder, notices) as reader:
        assert reader.trials(1) == trials
    with LedgerWriter.open(kept.folder, notices) as writer:
        assert writer.trials(1) == trials
        (event,) = writer.events(None)
    assert event.kind == "restored"
    assert (event.detail["rows"], event.detail["first"]) == (1, 14)
    check_files_agree(kept.folder)


def test_a_recovery_that_is_cut_off_is_begun_again(kept, notices, monkeypatch):
    with changed_bytes(kept.journal) as data:
        data[data.index(b'"kind":"run"') + 400] ^= 1
    kept.sqlite.write_bytes(kept.sqlite.read_bytes()[:-5000])

    def power_cut(path, rows):
        raise KeyboardInterrupt

    monkeypatch.setattr("labctl.ledger.store.recovery.build", power_cut)
    with pytest.raises(KeyboardInterrupt):
        LedgerWriter.open(kept.folder, notices)
    monkeypatch.undo()

    kept.check_all_there(notices)


def test_files_of_two_ledgers_are_not_mixed(kept, tmp_path):
    with LedgerWriter.open(tmp_path / "other", no_notice) as other:
        other.begin_run(a_run(note="another"))
    shutil.copy(tmp_path / "other" / "ledger.journal", kept.journal)
    before = {path.name: path.read_bytes() for path in kept.folder.glob("ledger.[js]*")}

    for kind in (Ledger, LedgerWriter):
        with pytest.raises(LabError, match=r"row 1 is the beginning of run 1 .* different ledgers"):
            kind.open(kept.folder, no_notice)

    assert {path.name: path.read_bytes() for path in kept.folder.glob("ledger.[js]*")} == before


@pytest.mark.parametrize("kind", [Ledger, LedgerWriter])
def test_another_version_is_refused(kept, kind):
    with closing(sqlite3.connect(kept.sqlite)) as connection:
        connection.execute("PRAGMA user_version = 2")

    with pytest.raises(BadInput, match="its schema is version 2, this labctl knows version 1"):
        kind.open(kept.folder, no_notice)


def test_a_journal_of_another_version_is_refused(kept):
    from labctl.ledger.store.rows import format_line

    with changed_bytes(kept.journal) as data:
        data[: data.index(b"\n") + 1] = format_line('"journal":"labctl ledger","version":7}')

    with pytest.raises(BadInput, match="written by version 7"):
        LedgerWriter.open(kept.folder, no_notice)


def test_another_programs_sqlite_file_is_left_alone(tmp_path):
    path = tmp_path / "ledger.sqlite"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE recipes (name TEXT)")
    before = path.read_bytes()

    with pytest.raises(BadInput, match="of another program"):
        LedgerWriter.open(tmp_path, no_notice)

    assert path.read_bytes() == before
