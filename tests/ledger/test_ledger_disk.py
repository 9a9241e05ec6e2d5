import errno
import os
import shutil
import sqlite3
import subprocess
from contextlib import contextmanager

import pytest
from made_ledger import Notices, a_run, a_trial, an_event, check_files_agree, make_ledger, no_notice

from labctl.errors import BadInput, LabError
from labctl.ledger.disk import disk_errors
from labctl.ledger.ledger import Ledger
from labctl.ledger.writer import LedgerWriter


@contextmanager
def mounted(folder, *options):
    """A small disk of memory; the test is skipped where none can be mounted."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", ",".join(options), "none", str(folder)]
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("a small disk is mounted by root only")
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("this machine mounts no tmpfs")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_reported_and_the_ledger_continues_when_it_has_room(tmp_path):
    with mounted(tmp_path / "disk", "size=640k") as disk:
        folder = disk / "ledger"
        ballast = disk / "ballast"
        ballast.write_bytes(b"x" * 200_000)
        with LedgerWriter.open(folder, no_notice) as ledger:
            run = ledger.begin_run(a_run())
            committed = 0
            with pytest.raises(LabError, match=r"the disk is full.*free some space") as full:
                while committed < 1000:
                    ledger.add_trial(a_trial(run.number, 1, committed + 1))
                    committed += 1
            assert full.value.exit_code == 1
            assert f"trial 1, attempt {committed + 1}, of run 1" in str(full.value)
            with pytest.raises(LabError, match="the disk is full"):
                ledger.add_trial(a_trial(run.number, 1, committed + 1))
            with Ledger.open(folder, no_notice) as reader:
                assert len(reader.trials(run.number)) == committed

            ballast.unlink()
            ledger.add_trial(a_trial(run.number, 1, committed + 1))
            trials = ledger.trials(run.number)

        assert len(trials) == committed + 1 > 10
        with LedgerWriter.open(folder, no_notice) as ledger:
            assert ledger.trials(run.number) == trials
        check_files_agree(folder)


def test_a_disk_that_is_full_from_the_start_takes_nothing_and_is_reported(tmp_path):
    with mounted(tmp_path / "disk", "size=192k") as disk:
        kept = make_ledger(disk / "ledger", trials=1)
        ballast = disk / "ballast"
        with pytest.raises(OSError, match="No space"):
            ballast.write_bytes(b"x" * 400_000)

        with pytest.raises(BadInput, match="the disk is full"):
            LedgerWriter.open(kept.folder, no_notice)
        with Ledger.open(kept.folder, no_notice) as reader:
            kept.check(reader)

        ballast.unlink()
        kept.check_all_there(no_notice)


def test_a_read_only_disk_can_be_read_and_is_refused_for_writing(tmp_path):
    with mounted(tmp_path / "disk", "size=2m") as disk:
        kept = make_ledger(disk / "closed")
        with LedgerWriter.open(disk / "open", no_notice) as writer:
            run = writer.begin_run(a_run())
            writer.add_trial(a_trial(run.number))
            shutil.copytree(disk / "open", disk / "killed")
            trials = writer.trials(run.number)
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)

        with Ledger.open(kept.folder, no_notice) as reader:
            kept.check(reader)
        with Ledger.open(disk / "killed", no_notice) as reader:
            assert reader.trials(run.number) == trials
        with pytest.raises(
            BadInput, match=r"Read-only file system .*Make the folder .* writable, or name another"
        ):
            LedgerWriter.open(kept.folder, no_notice)
        with pytest.raises(BadInput, match="Read-only file system"):
            LedgerWriter.open(disk / "new", no_notice)


def test_a_folder_that_is_a_file(tmp_path):
    (tmp_path / "ledger").write_text("not a folder")
    for folder in (tmp_path / "ledger", tmp_path / "ledger" / "deeper"):
        for kind in (Ledger, LedgerWriter):
            with pytest.raises(BadInput, match=r"is a file, and a ledger is a folder; name another"):
                kind.open(folder, no_notice)


@pytest.mark.parametrize("target", ["itself", "not-there"])
@pytest.mark.parametrize("opened", [Ledger, LedgerWriter])
def test_a_link_that_leads_nowhere(tmp_path, target, opened):
    link = tmp_path / "itself"
    link.symlink_to(tmp_path / target)

    for folder in (link, link / "ledger"):
        with pytest.raises(
            BadInput, match="itself is a link that leads nowhere; correct it, or name another"
        ):
            opened.open(folder, no_notice)


def test_a_file_that_may_not_be_read_is_to_be_made_readable(tmp_path):
    with (
        pytest.raises(LabError, match=r"Permission denied \(ledger.sqlite\).* readable"),
        disk_errors(tmp_path, "reading"),
    ):
        raise PermissionError(errno.EACCES, "Permission denied", "ledger.sqlite")


def test_no_ledger_to_read(tmp_path):
    with pytest.raises(BadInput, match=r"no ledger in .*; labctl run makes one"):
        Ledger.open(tmp_path / "nowhere", no_notice)
    assert not (tmp_path / "nowhere").exists()


def fail_once(monkeypatch, name, error, after=0):
    """Let one call of a function of `os` fail."""
    real, calls = getattr(os, name), []

    def failing(*arguments):
        calls.append(arguments)
        if len(calls) == after + 1:
            raise error
        return real(*arguments)

    monkeypatch.setattr(os, name, failing)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
@pytest.mark.parametrize("call", ["write", "fsync"])
def test_an_append_that_fails_leaves_no_half_row(tmp_path, monkeypatch, number, call):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())
        fail_once(monkeypatch, call, OSError(number, os.strerror(number)))
        with pytest.raises(LabError, match="writing trial 1, attempt 1, of run 1 failed"):
            ledger.add_trial(a_trial(run.number))
        monkeypatch.undo()
        assert ledger.trials(run.number) == ()

        ledger.add_trial(a_trial(run.number))
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        assert len(ledger.trials(run.number)) == 1
    check_files_agree(tmp_path)


def test_after_half_a_line_that_cannot_be_cut_nothing_more_is_appended(tmp_path, monkeypatch):
    notices = Notices()
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())
        real = os.write
        fail_once(monkeypatch, "write", OSError(errno.EIO, "Input/output error"), after=1)
        half = os.write
        monkeypatch.setattr(os, "write", lambda to, data: half(to, data[:100]))
        fail_once(monkeypatch, "ftruncate", OSError(errno.EIO, "Input/output error"))
        with pytest.raises(LabError, match="Input/output error"):
            ledger.add_trial(a_trial(run.number))
        monkeypatch.undo()
        assert os.write is real
        with pytest.raises(
            LabError, match=r"was not written, since an earlier append failed .* open the ledger again"
        ):
            ledger.add_event(an_event(run.number))

    with LedgerWriter.open(tmp_path, notices) as ledger:
        assert ledger.trials(run.number) == ()
        ledger.add_trial(a_trial(run.number))
    assert "set aside" in notices.text
    check_files_agree(tmp_path)


def test_an_append_that_is_interrupted_is_settled_when_the_ledger_is_opened_again(tmp_path, monkeypatch):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())

        def interrupted(connection, rows):
            raise KeyboardInterrupt

        monkeypatch.setattr("labctl.ledger.store.appender.insert", interrupted)
        with pytest.raises(KeyboardInterrupt):
            ledger.add_trial(a_trial(run.number))
        monkeypatch.undo()
        with pytest.raises(LabError, match="an earlier append was cut off"):
            ledger.add_event(an_event(run.number))

    with LedgerWriter.open(tmp_path, Notices()) as ledger:
        assert len(ledger.trials(run.number)) == 1
    check_files_agree(tmp_path)


def test_a_closed_ledger_takes_nothing(tmp_path):
    ledger = LedgerWriter.open(tmp_path, no_notice)
    ledger.close()
    ledger.close()

    with pytest.raises(LabError, match="it was closed"):
        ledger.begin_run(a_run())


def test_a_run_that_could_not_begin_leaves_its_number_to_the_next(tmp_path, monkeypatch):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        fail_once(monkeypatch, "write", OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
        with pytest.raises(LabError, match="the disk is full"):
            ledger.begin_run(a_run())
        monkeypatch.undo()

        assert ledger.begin_run(a_run()).number == 1


def test_sqlite_that_becomes_damaged_under_a_writer_is_repaired_by_the_next(tmp_path, monkeypatch):
    notices = Notices()
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        run = ledger.begin_run(a_run())
        malformed = sqlite3.DatabaseError("database disk image is malformed")
        malformed.sqlite_errorcode = sqlite3.SQLITE_CORRUPT

        def insert(connection, rows):
            raise malformed

        monkeypatch.setattr("labctl.ledger.store.appender.insert", insert)
        with pytest.raises(LabError, match=r"trial 1, attempt 1, of run 1 is safe in ledger.journal; open"):
            ledger.add_trial(a_trial(run.number))
        monkeypatch.undo()

    with LedgerWriter.open(tmp_path, notices) as ledger:
        assert ledger.trials(run.number) == (a_trial(run.number),)
    assert "put in" in notices.text
