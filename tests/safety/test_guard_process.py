"""The guard process: it arms, stands down, and nothing but the instruments can delay it."""

import os
import subprocess
import sys

import pytest

from labctl.clock import WallClock
from labctl.config.load import load_rig
from labctl.safety.guard import ENERGISED, GuardOrders, GuardProcess
from labctl.safety.reach import Reach, open_and_make_safe

pytestmark = pytest.mark.real_time

RIG = """
name = "bench"
[regulator]
driver = "alicat-ascii"
model = "PCD"
port = "/dev/ttyNOSUCH0"
pressure_unit = "psi"
[valves]
driver = "waveshare-relay"
transport = "rtu"
port = "/dev/ttyNOSUCH1"
channels = 8
[markers]
driver = "phasespace"
host = "127.0.0.1"
frequency_hz = 240
up = "+z"
points = [{id=0,x=10,y=70}, {id=1,x=130,y=70}, {id=2,x=70,y=10}, {id=3,x=70,y=130}]
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    return load_rig(path)


def test_orders_survive_the_pipe(config):
    orders = GuardOrders(Reach.of(config), 4711)
    assert GuardOrders.from_json(orders.to_json()) == orders


def test_arms_and_stands_down(config):
    guard = GuardProcess(config)
    guard.wait_armed()
    assert guard.alive()
    guard.stand_down()
    assert not guard.alive()


def test_a_guard_that_reads_nothing_is_noticed_and_makes_nobody_wait(config):
    guard = GuardProcess(config)
    guard.wait_armed()
    guard._process.send_signal(19)  # SIGSTOP
    for _ in range(70_000):
        guard.beat()
    assert not guard.alive()
    guard._process.send_signal(9)
    guard._process.wait()
    guard.release()


def test_instruments_that_stay_away_are_unsafe_and_reported(config):
    notes = []
    report = open_and_make_safe(Reach.of(config), WallClock(), patience_s=0.0, notify=notes.append)

    assert not report.safe
    assert any("/dev/ttyNOSUCH0" in line for line in notes)
    assert any("/dev/ttyNOSUCH1" in line for line in notes)


def test_a_guard_without_a_terminal_still_acts(config):
    orders = GuardOrders(Reach.of(config), os.getpid()).to_json() + "\n"
    # Its standard error is closed: the shell's 2>&-.
    process = subprocess.Popen(
        ["sh", "-c", f"exec {sys.executable} -m labctl.safety.guard_process 2>&-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    process.stdin.write(orders.encode() + ENERGISED)
    process.stdin.flush()
    assert process.stdout.readline() == b"armed\n"
    process.stdin.close()
    # It keeps trying to reach the rig instead of dying of what it cannot print.
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(7)
    process.kill()
    process.wait()
    process.stdout.close()
