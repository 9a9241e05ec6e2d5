"""`labctl` and doubles as processes, for tests of what only a process does.

No time-out here decides a test: each only ends what hangs.
"""

import json
import os
import select
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from virtual_labctl import Ended

LABCTL = (sys.executable, "-m", "labctl")
PATIENT_S = 300.0
# The product's own deadlines, as long as a rig.toml may have them.
PATIENT_RIG = (
    (
        "[limits]\n",
        '[limits]\nstale_after = "2 s"\n'
        'settle_timeout = "5 min"\nfollow_timeout = "1 min"\nvent_timeout = "1 min"\n',
    ),
    ('timeout = "0.5 s"\n', 'timeout = "1 s"\n'),
)


def wait_until(condition, within_s=PATIENT_S):
    end_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s, "did not happen in time"
        time.sleep(0.02)


@dataclass
class Served:
    """A set of doubles that runs: its rig.toml and the log of its plant's truth."""

    rig: Path
    trace: Path

    def rows(self):
        """The plant's truth so far."""
        return [json.loads(line) for line in self._lines()]

    def last(self):
        return json.loads(self._lines()[-1])

    def is_safe(self):
        row = self.last()
        safe = row["setpoint_psi"] == 0 and row["exhausting"]
        return safe and row["pressure_psi"] < 0.3 and not row["coils"]

    def _lines(self):
        return [line for line in self.trace.read_text().splitlines() if line.endswith("}")]


@contextmanager
def serve_doubles(folder, *options, patient=True):
    """`labctl doubles serve` until the block ends; time runs five times as fast unless told otherwise.

    `patient` gives the product's deadlines in the rig.toml all the room that there is, for a test of something else.
    """
    served = Served(folder / "rig.toml", folder / "trace.jsonl")
    command = [*LABCTL, "doubles", "serve", "--json", "--out", served.rig, "--trace", served.trace]
    process = subprocess.Popen(
        [*map(str, command), *(("--speed", "5") if "--speed" not in options else ()), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        ready, _, _ = select.select([process.stdout], [], [], PATIENT_S)
        assert ready, "the doubles were not ready in time"
        assert "rig" in json.loads(process.stdout.readline())
        if patient:
            text = served.rig.read_text()
            for short, long in PATIENT_RIG:
                assert short in text
                text = text.replace(short, long)
            served.rig.write_text(text)
        yield served
    finally:
        process.terminate()
        process.wait(PATIENT_S)
        process.stdout.close()


def run_labctl(*arguments, **options):
    """Run a command to its end as a process of its own."""
    done = subprocess.run(
        [*LABCTL, *map(str, arguments)], capture_output=True, text=True, timeout=PATIENT_S, **options
    )
    return Ended(done.returncode, done.stdout, done.stderr)


class Running:
    """A labctl that runs, whose progress can be waited for and which can be signalled."""

    def __init__(self, *arguments):
        read, write = os.pipe()
        self.process = subprocess.Popen(
            [*LABCTL, *map(str, arguments)], stdout=subprocess.PIPE, stderr=write, start_new_session=True
        )
        os.close(write)
        self._read = read
        self.err = ""

    def wait_for(self, text):
        """Read standard error until `text` has come."""
        end_s = time.monotonic() + PATIENT_S
        while text not in self.err:
            assert self._read is not None, f"{text!r} did not come; standard error:\n{self.err}"
            assert time.monotonic() < end_s, f"{text!r} did not come; standard error so far:\n{self.err}"
            self._read_some()

    def signal(self, number=signal.SIGINT):
        self.process.send_signal(number)

    def end(self):
        out, _ = self.process.communicate(timeout=PATIENT_S)
        return Ended(self.process.returncode, out.decode(), self.err)

    def read_rest(self):
        """Read until everybody who holds standard error, the guard too, has closed it."""
        end_s = time.monotonic() + PATIENT_S
        while self._read is not None:
            assert time.monotonic() < end_s, f"standard error is held still; so far:\n{self.err}"
            self._read_some()

    def _read_some(self):
        ready, _, _ = select.select([self._read], [], [], 0.05)
        if ready:
            data = os.read(self._read, 65536)
            self.err += data.decode()
            if not data:
                os.close(self._read)
                self._read = None

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        if self._read is not None:
            os.close(self._read)
