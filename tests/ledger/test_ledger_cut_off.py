"""A program that is cut off at each of its calls to the disk in turn: what follows must find everything."""

import os
import shutil
from itertools import count
from pathlib import Path

import pytest
from made_ledger import Notices, a_trial, an_event, changed_bytes, check_files_agree, no_notice

from labctl.ledger.ledger import Ledger
from labctl.ledger.store import appender, recovery, tables
from labctl.ledger.writer import LedgerWriter


class CutOff(BaseException):
    """The program ends here, and does nothing more."""


@pytest.fixture
def cut_off_at(monkeypatch):
    """From the n-th call on, every call that would change the disk raises instead."""

    def arm(limit):
        calls = count()

        def cut(real):
            def call(*arguments, **named):
                if next(calls) >= limit:
                    raise CutOff
                return real(*arguments, **named)

            return call

        for holder, name in (
            (os, "write"),
            (os, "fsync"),
            (os, "ftruncate"),
            (Path, "replace"),
            (Path, "write_bytes"),
            (shutil, "copyfile"),
            (tables, "_insert"),
            (recovery, "insert"),
            (recovery, "build"),
            (appender, "insert"),
        ):
            monkeypatch.setattr(holder, name, cut(getattr(holder, name)))

    yield arm
    monkeypatch.undo()


def test_an_append_cut_off_anywhere_is_there_or_not(copy_kept, cut_off_at, monkeypatch):
    outcomes = []
    for limit in range(30):
        kept = copy_kept(limit)
        ledger = LedgerWriter.open(kept.folder, no_notice)
        cut_off_at(limit)
        try:
            ledger.add_event(an_event(1, "paused", last=True))
            outcomes.append("returned")
        except CutOff:
            outcomes.append("cut")
        monkeypatch.undo()
        ledger.close()

        with LedgerWriter.open(kept.folder, Notices()) as after:
            kept.check(after)
            there = after.events(1)[-1].detail == {"last": True}
        check_files_agree(kept.folder)
        assert there or outcomes[-1] == "cut"
        if outcomes[-1] == "returned":
            break
    assert outcomes[-1] == "returned"
    assert len(outcomes) > 3


def damage(kept):
    """A row of the journal, another of SQLite, and an unfinished append."""
    with changed_bytes(kept.journal) as data:
        data[data.index(b'"kind":"trial","run":1,"trial":2') + 400] ^= 1
        data += b'{"sha256":"0123'
    with changed_bytes(kept.sqlite) as data:
        data[data.index(b'{"run":1,"number":3,') + 400] ^= 1


def test_a_recovery_cut_off_anywhere_is_finished_by_the_next(copy_kept, cut_off_at, monkeypatch):
    for limit in range(60):
        kept = copy_kept(limit)
        damage(kept)
        cut_off_at(limit)
        finished = False
        try:
            LedgerWriter.open(kept.folder, Notices()).close()
            finished = True
        except CutOff:
            pass
        monkeypatch.undo()

        with Ledger.open(kept.folder, Notices()) as reader:
            kept.check(reader)
        kept.check_all_there(Notices())
        with LedgerWriter.open(kept.folder, no_notice) as ledger:
            ledger.add_trial(a_trial(1, 9))
        if finished:
            break
    assert finished
    assert limit > 5
