"""Doubles in a process of their own, and labctl run against them as a person or a script would."""

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

import pytest

LABCTL = (sys.executable, "-m", "labctl")
READY_TIMEOUT_S = 90.0


@dataclass
class Served:
    """A set of doubles that runs: its rig.toml and the log of its plant's truth."""

    rig: Path
    trace: Path

    def rows(self):
        """The plant's truth so far."""
        lines = self.trace.read_text().splitlines()
        return [json.loads(line) for line in lines if line.endswith("}")]

    def last(self):
        return self.rows()[-1]


@contextmanager
def serve_doubles(folder, *options):
    """`labctl doubles serve` until the block ends; time runs five times as fast unless told otherwise."""
    served = Served(folder / "rig.toml", folder / "trace.jsonl")
    command = [*LABCTL, "doubles", "serve", "--json", "--out", served.rig, "--trace", served.trace]
    process = subprocess.Popen(
        [*map(str, command), *(("--speed", "5") if "--speed" not in options else ()), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        ready, _, _ = select.select([process.stdout], [], [], READY_TIMEOUT_S)
        assert ready, "the doubles were not ready in time"
        assert "rig" in json.loads(process.stdout.readline())
        yield served
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()


@dataclass
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str


def run_labctl(*arguments, timeout_s=60):
    done = subprocess.run([*LABCTL, *map(str, arguments)], capture_output=True, text=True, timeout=timeout_s)
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

    def wait_for(self, text, timeout_s=40):
        """Read standard error until `text` has come."""
        end_s = time.monotonic() + timeout_s
        while text not in self.err:
            assert time.monotonic() < end_s, f"{text!r} did not come; standard error so far:\n{self.err}"
            self._read_some()

    def signal(self, number=signal.SIGINT):
        self.process.send_signal(number)

    def end(self, timeout_s=40):
        out, _ = self.process.communicate(timeout=timeout_s)
        return Ended(self.process.returncode, out.decode(), self.err)

    def read_rest(self, timeout_s=15):
        """Read until everybody who holds standard error, the guard too, has closed it."""
        end_s = time.monotonic() + timeout_s
        while self._read is not None and time.monotonic() < end_s:
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


@pytest.fixture
def start():
    """Start a labctl in the background; it is gone when the test ends."""
    running = []

    def begin(*arguments):
        running.append(Running(*arguments))
        return running[-1]

    yield begin
    for one in running:
        one.close()


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    """Doubles without faults, shared by the tests that leave them SAFE."""
    with serve_doubles(tmp_path_factory.mktemp("doubles")) as doubles:
        yield doubles


@pytest.fixture(scope="session")
def fast(tmp_path_factory):
    """Doubles at twenty times their time, for runs of several trials."""
    with serve_doubles(tmp_path_factory.mktemp("fast"), "--speed", "20") as doubles:
        yield doubles


@pytest.fixture(scope="session")
def labctl():
    return run_labctl


@pytest.fixture
def doubles_with(tmp_path):
    """Doubles with options of the test's own."""
    return lambda *options: serve_doubles(tmp_path, *options)
