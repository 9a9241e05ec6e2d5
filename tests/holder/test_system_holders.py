"""Who holds a rig, between real processes: locks, sockets, signals."""

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import pytest
from labctl_process import wait_until

from labctl.errors import BadInput, NoAnswer
from labctl.holder.entries import Locked, look, path_of
from labctl.holder.interfaces import RigHeld
from labctl.holder.records import VERSION, RigState
from labctl.holder.system import ProcessHeld, SystemHolders
from labctl.holder.this_holder import this_holder

pytestmark = pytest.mark.real_time

ADDRESSES = ("port /dev/ttyA", "port /dev/ttyB")
HOLDER = """
import sys, time
from pathlib import Path
from labctl.holder.records import VERSION, RigState
from labctl.holder.system import SystemHolders
from labctl.holder.this_holder import this_holder

me = this_holder("command", "bench", "/rig.toml", simulated=True)

class Answers:
    asked = None
    def state(self):
        return RigState(VERSION, me, "open", 1.0, step="hold", asked_by=self.asked)
    def request(self, word, request):
        self.asked = f"{word} by {request.pid}"

holding = SystemHolders((Path(sys.argv[1]),)).hold(me, sys.argv[2:], {"a": 1}, Answers(), 1.0)
print("held", flush=True)
sys.stdin.read()
holding.release()
"""


@pytest.fixture
def folder():
    # A socket's name is short.
    with tempfile.TemporaryDirectory(prefix="lab") as folder:
        yield Path(folder) / "labctl"


@pytest.fixture
def holders(folder):
    return SystemHolders((folder,))


@pytest.fixture
def start(folder):
    running = []

    def begin(*addresses):
        process = subprocess.Popen(
            [sys.executable, "-c", HOLDER, str(folder), *(addresses or ADDRESSES)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        running.append(process)
        assert process.stdout.readline() == b"held\n"
        return process

    yield begin
    for process in running:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()


def hold(holders, *addresses, answerer=None):
    me = this_holder("command", "bench", "/rig.toml", simulated=True)
    return holders.hold(me, addresses or ADDRESSES, {}, answerer, 0.0)


def answer_of(held):
    with closing(held.ask("state", 1.0)) as conversation:
        return conversation.next_state(1.0)


def test_a_holder_is_found_by_any_address_and_answers(holders, start):
    process = start()

    for address in ADDRESSES:
        (held,) = holders.find([address])
        assert held.pid == held.entry.holder.pid == process.pid
        assert held.entry.reach == {"a": 1}
    assert len(holders.all()) == 1
    assert holders.find(["port /dev/ttyC"]) == ()
    state = answer_of(held)
    assert (state.step, state.asked_by) == ("hold", None)


def test_one_of_two_holds_a_rig(holders, start):
    start(ADDRESSES[1])
    with pytest.raises(RigHeld, match="bench is held by process"):
        hold(holders)
    # What the other does not hold was not kept.
    hold(holders, ADDRESSES[0]).release()


def test_a_request_is_answered_and_followed_until_the_holder_lets_go(holders, start):
    process = start()
    (held,) = holders.find(ADDRESSES)
    with closing(held.ask("vent", 1.0)) as conversation:
        assert conversation.next_state(1.0).asked_by == f"vent by {os.getpid()}"
        process.stdin.close()
        states = []
        while (state := conversation.next_state(2.0)) is not None:
            states.append(state)
    assert states[-1].ended
    process.wait(5)
    assert holders.find(ADDRESSES) == ()


def test_a_holder_that_was_killed_holds_nothing_and_its_socket_is_in_nobody_s_way(holders, start):
    process = start()
    process.kill()
    process.wait()

    assert holders.all() == ()
    start()
    assert answer_of(*holders.find(ADDRESSES)).step == "hold"


def test_a_holder_that_has_stopped_does_not_answer_and_can_be_ended(holders, start):
    process = start()
    process.send_signal(signal.SIGSTOP)
    (held,) = holders.find(ADDRESSES)

    with pytest.raises(NoAnswer, match="has been stopped"):
        wait_until(lambda: held.ask("vent", 1.0).close())
    held.end()
    assert process.wait(5) == -signal.SIGKILL
    assert not held.is_held()
    hold(holders).release()


def test_whoever_let_go_is_not_ended_in_place_of_the_next(holders, start):
    first = start()
    (held,) = holders.find(ADDRESSES)
    first.stdin.close()
    first.wait(5)
    second = start()

    held.end()
    assert second.poll() is None
    assert not held.is_held()


def test_a_process_that_does_not_hold_the_rig_is_never_ended(folder, start):
    bystander = start("port /dev/ttyC")
    start()
    path = path_of(folder, ADDRESSES[0])
    ProcessHeld(Locked(path, bystander.pid, look(path).entry)).end()

    with pytest.raises(subprocess.TimeoutExpired):
        bystander.wait(0.5)


def test_what_a_file_says_counts_only_while_it_is_locked(holders, folder, start):
    process = start()
    process.kill()
    process.wait()
    path = path_of(folder, ADDRESSES[0])
    assert json.loads(path.read_text())["holder"]["pid"] == process.pid
    assert holders.find(ADDRESSES) == ()


def test_a_link_in_the_place_of_a_file_is_not_followed(holders, folder, tmp_path):
    folder.mkdir(0o700)
    path_of(folder, ADDRESSES[0]).symlink_to(tmp_path / "somewhere")
    with pytest.raises(BadInput, match="symbolic links"):
        hold(holders)
    assert not (tmp_path / "somewhere").exists()


class Answers:
    """A holder that says what it was told to."""

    def __init__(self):
        self.steps = 0
        self.holder = this_holder("command", "bench", "/rig.toml", simulated=True)

    def state(self):
        self.steps += 1
        return RigState(VERSION, self.holder, "open", 1.0, step=str(self.steps), detail="x" * 4000)

    def request(self, word, request):
        pass


def connect(folder, sent):
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.settimeout(5)
    listener.connect(str(path_of(folder, ADDRESSES[0]).with_suffix(".sock")))
    listener.sendall(sent)
    return listener


def test_who_does_not_read_and_who_talks_nonsense_keep_nobody_from_an_answer(folder, holders):
    watch = json.dumps({"version": VERSION, "ask": "watch", "pid": 1, "user": "anna"}).encode() + b"\n"
    holding = hold(holders, answerer=Answers())
    deaf = [connect(folder, watch) for _ in range(5)]
    mad = [connect(folder, b"\xff\x00 no request\n"), connect(folder, b"x" * 100_000), connect(folder, b"{")]
    time.sleep(1.0)
    start_s = time.monotonic()
    with connect(folder, watch) as listener:
        assert listener.recv(200).startswith(b'{"version": 1')
    assert time.monotonic() - start_s < 0.3
    # The deaf one gets what is true now, not the backlog of a second.
    start_s = time.monotonic()
    holding.release()
    assert time.monotonic() - start_s < 0.6
    for one in (*deaf, *mad):
        one.close()
