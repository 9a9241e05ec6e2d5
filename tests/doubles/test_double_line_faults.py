"""What wires and boxes add to a device's bytes, by the names of `labctl doubles serve --fault`."""

import numpy as np
import pytest

from labctl.doubles.device_end import DeviceEnd
from labctl.doubles.faults import FaultPanel, parse_faults
from labctl.doubles.line_faults import LineFaults

FRAME = b"A +003.90 +003.90\r"


class Parrot:
    """Answers every line with the same frame; `heard` is what came."""

    waiting = False

    def __init__(self, is_text=True):
        self.is_text = is_text
        self.heard = b""

    def receive(self, data):
        self.heard += data
        return [FRAME]

    def idle(self):
        return []

    def unprompted(self):
        return b""

    def readdressed(self, reply):
        return b"B" + reply[1:]


@pytest.fixture
def end(clock):
    def make(*words, line=None, on_reboot=lambda: None):
        faults = parse_faults([f"regulator={word}" for word in words]).regulator
        lines = LineFaults(FaultPanel(clock, faults), clock, np.random.default_rng(0), on_reboot)
        return DeviceEnd(line or Parrot(), lines, clock)

    return make


def asked(end, clock, wait_s=1.0):
    """What has come so long after a question."""
    end.receive(b"A\r")
    came = []
    for _ in range(round(wait_s / 0.005)):
        came += end.take_due()
        clock.sleep(0.005)
    return came


@pytest.mark.parametrize(
    ("word", "sent"),
    [
        ("echo", [b"A\r", FRAME]),
        ("stray-before", [b"\x00\xff" + FRAME]),
        ("stray-after", [FRAME + b"\x00\xff"]),
        ("stray-between", [FRAME, b"\x00\xff"]),
        ("nul", [FRAME + b"\x00"]),
        ("crlf", [FRAME + b"\n"]),
        ("blank-lines", [b"\r" + FRAME + b"\r"]),
        ("escapes", [b"A +003.90 +003.90\x1b[2J\r"]),
        ("split:0.03", [b"A +003.90", b" +003.90\r"]),
        ("trickle:0.002", [bytes([byte]) for byte in FRAME]),
    ],
)
def test_what_a_fault_adds(end, clock, word, sent):
    assert asked(end(word), clock) == sent


def test_to_a_frame_it_is_added_behind_and_not_within(end, clock):
    assert asked(end("nul", line=Parrot(is_text=False)), clock) == [FRAME + b"\x00"]
    assert asked(end("crlf", line=Parrot(is_text=False)), clock) == [FRAME + b"\r\n"]


def test_an_answer_is_late_once(end, clock):
    one = end("late-once:0.5")
    assert asked(one, clock, 0.4) == []
    assert asked(one, clock, 0.4) == [FRAME, FRAME]
    assert asked(one, clock, 0.1) == [FRAME]


def test_each_answer_waits_for_the_next_question(end, clock):
    one = end("previous")
    assert asked(one, clock) == []
    assert asked(one, clock) == [FRAME]


def test_a_reboot_loses_the_question_resets_the_device_and_ends_in_a_banner(end, clock):
    line, resets = Parrot(), []
    one = end("reboot", line=line, on_reboot=lambda: resets.append(True))
    assert asked(one, clock, 0.5) == []
    assert asked(one, clock, 0.6) == [b"\x00\xffreset\r\n"]
    assert (line.heard, resets) == (b"", [True])
    assert asked(one, clock, 0.1) == [FRAME]
