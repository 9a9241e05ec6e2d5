"""Tests that need the machine's own time: processes, signals, deadlines on real wires.

Each is marked `real_time`, and runs beside a bare sleeper: a process that does nothing but sleep for 10 ms at a time,
and knows how late it was woken. A test that fails while the sleeper was later than the test's margin shows nothing
about the program: it is repeated, and reported as repeated. One that passes all the same is reported with how late
the machine was. A test that fails on a machine that was on time has failed, and so has one that failed in every
try.
"""

import subprocess
import sys
from dataclasses import dataclass

import pytest
from _pytest.runner import runtestprotocol

MARGIN_S = 0.02
TRIES = 3

_SLEEPER = """
import os, select, time
worst_s = 0.0
while True:
    start_s = time.monotonic()
    if select.select([0], [], [], 0.01)[0]:
        if not os.read(0, 1):
            break
        os.write(1, f"{worst_s}\\n".encode())
        worst_s = 0.0
    else:
        worst_s = max(worst_s, time.monotonic() - start_s - 0.01)
"""


class Sleeper:
    """The process beside the tests."""

    def __init__(self):
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-c", _SLEEPER], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def worst_s(self):
        """How late it was woken at worst since it was last asked, in seconds."""
        self._process.stdin.write(b"?")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())

    def close(self):
        self._process.stdin.close()
        self._process.wait(10)
        self._process.stdout.close()


@dataclass(frozen=True)
class Late:
    """A try of a test beside which the machine was later than the test's margin."""

    test: str
    attempt: int
    late_s: float
    outcome: str


class RealTime:
    """The plug-in: runs each marked test beside the sleeper."""

    def __init__(self):
        self._sleeper = None
        self.late = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item, nextitem):
        mark = item.get_closest_marker("real_time")
        if mark is None:
            return None
        margin_s = mark.kwargs.get("margin_s", MARGIN_S)
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for report in self._tried(item, nextitem, margin_s):
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def _tried(self, item, nextitem, margin_s):
        """The reports of the try that counts."""
        self._sleeper = self._sleeper or Sleeper()
        for attempt in range(1, TRIES + 1):
            self._sleeper.worst_s()
            reports = runtestprotocol(item, nextitem=nextitem, log=False)
            late_s = self._sleeper.worst_s()
            failed = any(report.failed for report in reports)
            if late_s > margin_s:
                outcome = "passed" if not failed else "repeated" if attempt < TRIES else "failed"
                self.late.append(Late(item.nodeid, attempt, late_s, outcome))
            if not failed or late_s <= margin_s:
                break
            if attempt < TRIES:
                item._initrequest()
        return reports

    def pytest_terminal_summary(self, terminalreporter):
        if not self.late:
            return
        terminalreporter.section("the machine was later than a test's margin")
        passed = [late for late in self.late if late.outcome == "passed"]
        for late in self.late:
            if late.outcome != "passed":
                terminalreporter.line(
                    f"{late.outcome}: {late.test}, try {late.attempt}, {1e3 * late.late_s:.0f} ms late"
                )
        if passed:
            worst = max(passed, key=lambda late: late.late_s)
            terminalreporter.line(
                f"passed all the same: {len(passed)} tests, at worst {1e3 * worst.late_s:.0f} ms late ({worst.test})"
            )

    def pytest_unconfigure(self):
        if self._sleeper is not None:
            self._sleeper.close()


def pytest_configure(config):
    config.addinivalue_line(
        "markers",
        "real_time(margin_s=0.02): needs the machine's own time; runs apart (tests/real_time.py)",
    )
    config.pluginmanager.register(RealTime(), "real time")
