"""What `labctl run` asks of the person at the terminal: another sheet, with the rig SAFE."""

import os
import pty
from types import SimpleNamespace

import pytest

from labctl.cli.outcome import Outcome
from labctl.cli.output import ProgressLine
from labctl.cli.run.session import what_a_stop_does
from labctl.cli.run.text import RunReporter
from labctl.errors import BadInput, Stopped

SHEETS = [SimpleNamespace(sheet="the sheet glued cylinder on sphere")]


class RigInHand:
    """A rig whose wait is an event: what the person does meanwhile is done there."""

    def __init__(self, *deeds):
        self.deeds = list(deeds)
        self.waited = 0

    def wait(self, _seconds):
        self.waited += 1
        if self.deeds:
            self.deeds.pop(0)()


@pytest.fixture
def terminal(monkeypatch):
    """The person's end of the terminal that the program reads from."""
    person, program = pty.openpty()
    with os.fdopen(program, "r") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield person
    os.close(person)


def teller(simulated=False):
    return RunReporter(ProgressLine(quiet=True), SimpleNamespace(simulated=simulated), SHEETS, quiet=True)


def test_a_sheet_is_waited_for_until_enter(terminal):
    rig = RigInHand(lambda: None, lambda: os.write(terminal, b"\n"))

    teller().observer().mount_sheet(SHEETS[0].sheet, rig)

    assert rig.waited == 2


def test_an_enter_from_before_the_question_is_no_sheet(terminal):
    os.write(terminal, b"\n")
    rig = RigInHand(lambda: None, lambda: os.write(terminal, b"\n"))

    teller().observer().mount_sheet(SHEETS[0].sheet, rig)

    assert rig.waited == 2


def test_a_stop_ends_the_waiting(terminal):
    def stop():
        raise Stopped("stopped by Ctrl-C")

    with pytest.raises(Stopped):
        teller().observer().mount_sheet(SHEETS[0].sheet, RigInHand(stop))


def test_the_end_of_input_is_no_sheet(terminal):
    rig = RigInHand(lambda: os.write(terminal, b"\x04"))

    with pytest.raises(Stopped, match="end of the terminal's input"):
        teller().observer().mount_sheet(SHEETS[0].sheet, rig)


def test_the_doubles_sheet_is_not_asked_for(terminal):
    rig = RigInHand()

    teller(simulated=True).observer().mount_sheet(SHEETS[0].sheet, rig)

    assert rig.waited == 0


def test_without_a_terminal_another_sheet_is_refused_beforehand(monkeypatch):
    with open(os.devnull) as nobody:  # noqa: PTH123 - the shortest stream that is no terminal
        monkeypatch.setattr("sys.stdin", nobody)
        with pytest.raises(BadInput, match="at a terminal"):
            teller()


@pytest.mark.parametrize(
    ("presence", "words"),
    [
        (None, "nothing was energised"),
        (SimpleNamespace(may_be_open=False), "nothing was energised"),
        (SimpleNamespace(may_be_open=True), "taking the rig to SAFE"),
    ],
)
def test_a_stop_says_whether_there_is_anything_to_take_to_safe(presence, words):
    say = what_a_stop_does(Outcome(presence=presence))
    assert words in say()
