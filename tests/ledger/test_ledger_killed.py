import random
import signal
import subprocess
import sys
import time

import pytest
from made_ledger import Notices, a_run, an_event, check_files_agree, make_ledger, no_notice

from labctl.ledger.ledger import Ledger
from labctl.ledger.state import run_state
from labctl.ledger.writer import LedgerWriter

# Adds attempts as fast as it can, and says each once the ledger has returned.
WRITER = """
import sys
from pathlib import Path
from made_ledger import a_trial
from labctl.ledger.state import run_state
from labctl.ledger.writer import LedgerWriter

with LedgerWriter.open(Path(sys.argv[1]), lambda text: None) as ledger:
    attempt = len(ledger.trials(1))
    while True:
        attempt += 1
        ledger.add_trial(a_trial(1, 1, attempt, reason="x" * (attempt % 7 * 3000)))
        print(attempt, flush=True)
"""


def start_writer(folder):
    return subprocess.Popen(
        [sys.executable, "-c", "import sys; sys.path.insert(0, 'tests')\n" + WRITER, str(folder)],
        stdout=subprocess.PIPE,
        text=True,
    )


def test_kill_9_at_any_moment_loses_nothing_that_was_committed(tmp_path):
    chance = random.Random(20260301)
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        ledger.begin_run(a_run())
    said = 0
    for _ in range(8):
        process = start_writer(tmp_path)
        first = process.stdout.readline()
        time.sleep(chance.uniform(0, 0.08))
        process.kill()
        rest = process.stdout.read()
        assert process.wait() == -signal.SIGKILL
        process.stdout.close()
        said = int((first + rest).split()[-1])

        with Ledger.open(tmp_path, Notices()) as ledger:
            attempts = [trial.attempt for trial in ledger.trials(1)]
            assert ledger.state(1) == "interrupted"
        assert attempts == list(range(1, len(attempts) + 1))
        assert said <= len(attempts) <= said + 1

    LedgerWriter.open(tmp_path, Notices()).close()
    check_files_agree(tmp_path)
    assert said >= 8


def test_a_ledger_is_read_while_another_process_writes_it(tmp_path):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        ledger.begin_run(a_run())
    process = start_writer(tmp_path)
    try:
        for _ in range(30):
            said = int(process.stdout.readline())
            with Ledger.open(tmp_path, no_notice) as ledger:
                attempts = [trial.attempt for trial in ledger.trials(1)]
                assert ledger.state(1) == "running"
            assert attempts == list(range(1, len(attempts) + 1))
            assert len(attempts) >= said
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_run_is_running_while_its_own_writer_lives(tmp_path):
    """An older run without an end was interrupted, whoever writes now."""
    kept = make_ledger(tmp_path, trials=1)
    with Ledger.open(tmp_path, no_notice) as ledger:
        assert ledger.state(kept.run.number) == "interrupted"
    with LedgerWriter.open(tmp_path, no_notice) as writer:
        later = writer.begin_run(a_run())
        assert writer.state(kept.run.number) == "interrupted"
        assert writer.state(later.number) == "running"
        with Ledger.open(tmp_path, no_notice) as ledger:
            assert ledger.state(kept.run.number) == "interrupted"
            assert ledger.state(later.number) == "running"


@pytest.mark.parametrize(
    ("kinds", "writing", "state"),
    [
        ((), True, "running"),
        ((), False, "interrupted"),
        (("trial-begun", "paused"), True, "running"),
        (("interrupted",), True, "interrupted"),
        (("interrupted", "continued"), True, "running"),
        (("interrupted", "continued"), False, "interrupted"),
        (("failed", "continued", "finished"), True, "finished"),
        (("finished", "clock-set-back"), False, "finished"),
        (("failed",), False, "failed"),
    ],
)
def test_how_a_run_stands(kinds, writing, state):
    assert run_state([an_event(1, kind) for kind in kinds], writing=writing) == state
