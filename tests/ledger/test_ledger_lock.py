import os
import signal
import subprocess
import sys

import pytest
from made_ledger import a_run, no_notice

from labctl.errors import BadInput
from labctl.ledger.lock import holder_of, last_seq_of
from labctl.ledger.writer import LedgerWriter

HOLDER = """
import sys, time
from pathlib import Path
from labctl.ledger.writer import LedgerWriter

with LedgerWriter.open(Path(sys.argv[1]), lambda text: None):
    print("holding", flush=True)
    time.sleep(3600)
"""


@pytest.fixture
def other(tmp_path):
    """Another process that has the ledger open to write."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "holding\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_second_writer_is_refused_with_who_writes(tmp_path, other):
    with pytest.raises(BadInput) as refused:
        LedgerWriter.open(tmp_path, no_notice)

    assert f"process {other.pid} on " in str(refused.value)
    assert f"-c {tmp_path}" in str(refused.value)
    assert "name another folder with --ledger" in str(refused.value)
    assert holder_of(tmp_path).pid == other.pid


def test_a_long_command_in_any_letters_leaves_the_lock_readable(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["labctl", "run", "five-trial", "--note", "\U0001f600" * 300])
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        ledger.begin_run(a_run())
        assert holder_of(tmp_path).pid == os.getpid()
        assert "--note" in holder_of(tmp_path).command
    monkeypatch.setattr(sys, "argv", ["labctl"])
    assert last_seq_of(tmp_path) == 1
    with LedgerWriter.open(tmp_path, no_notice):
        assert holder_of(tmp_path).command == "labctl"


def test_what_a_longer_lock_leaves_behind_is_not_read(tmp_path):
    (tmp_path / "ledger.lock").write_bytes(b"x" * 3000)
    with LedgerWriter.open(tmp_path, no_notice):
        assert holder_of(tmp_path).pid == os.getpid()


def test_the_lock_of_a_dead_process_does_not_count(tmp_path, other):
    other.send_signal(signal.SIGKILL)
    other.wait()

    assert holder_of(tmp_path) is None
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        ledger.begin_run(a_run())
        assert holder_of(tmp_path).pid == os.getpid()
    assert holder_of(tmp_path) is None


def test_a_child_process_does_not_keep_the_lock(tmp_path):
    with LedgerWriter.open(tmp_path, no_notice):
        child = subprocess.Popen(["sleep", "3600"], close_fds=False)
    try:
        LedgerWriter.open(tmp_path, no_notice).close()
    finally:
        child.kill()
        child.wait()


def test_two_writers_of_one_process_are_refused_too(tmp_path):
    with LedgerWriter.open(tmp_path, no_notice), pytest.raises(BadInput, match=f"process {os.getpid()} on"):
        LedgerWriter.open(tmp_path, no_notice)
