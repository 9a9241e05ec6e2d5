"""An instrument that answers in order, each answer when its time has come, in the test's own time."""

import random
from collections import deque
from contextlib import suppress

import pytest
from virtual_time import VirtualTime

from labctl.errors import GarbledReply, InstrumentError, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.line_resync import HOLD_S, Probe, Stream
from labctl.links.serial_link import SerialLink

VERSION = Probe(b"AVE\r", lambda line: line.startswith(b"A   10v"))
MAKER = Probe(b"A??M*\r", lambda line: line.startswith(b"A M"), many_lines=True)
TABLE = Probe(b"A??D*\r", lambda line: line.startswith(b"A D"), many_lines=True)
POLL = b"A\r"


class InOrder:
    """Answers each question after its delay, never before the one to the question before; `delays_s` are used up.

    A poll is answered by its own number, which the test compares with the number of polls asked so far. `lost` are
    questions that get no answer; `unasked` is sent every `every_s` until the stream is ended.
    """

    name = "regulator A"

    def __init__(self, time, delays_s=(), lost=(), every_s=None):
        self.time = time
        self.delays_s = deque(delays_s)
        self.lost = lost
        self.heard = []
        self.polls = 0
        self.due = deque()
        self.every_s = every_s
        self.next_s = time.now_s()

    def write(self, data, deadline):
        self.heard.append(data)
        if data == b"@@=A\r":
            self.every_s = None
        elif self.every_s is None:
            self.polls += data == POLL
            delay_s = self.delays_s.popleft() if self.delays_s else 0.0
            if data not in self.lost:
                due_s = max([self.time.now_s() + delay_s] + [due_s for due_s, _ in self.due])
                self.due.append((due_s, self._answer(data)))

    def _answer(self, data):
        answers = {
            b"AVE\r": b"A   10v20\r",
            b"A??M*\r": b"A M00 x\rA M01 y\r",
            b"A??D*\r": b"A D00 x\rA D01 y\r",
        }
        return answers.get(data, b"A %d\r" % self.polls)

    def read_some(self, limit, deadline):
        while not self.has_input():
            if deadline.expired:
                return b""
            self.time.sleep(min(0.005, deadline.remaining_s() + 1e-9))
        return self.due.popleft()[1]

    def has_input(self):
        if self.every_s is not None and self.time.now_s() >= self.next_s:
            self.next_s = self.time.now_s() + self.every_s
            self.due.append((self.time.now_s(), b"@ +003.90 +003.90\r"))
        return bool(self.due) and self.due[0][0] <= self.time.now_s()

    def close(self):
        pass


@pytest.fixture
def time():
    return VirtualTime()


def linked(device, *probes, synchronised=True):
    link = SerialLink(device, device.time)
    link.resync_by(probes or (VERSION, MAKER, TABLE))
    if synchronised:
        assert poll(link, device) == device.polls
        device.heard.clear()
    return link


def poll(link, device, within_s=0.2):
    return int(link.exchange_line(POLL, Deadline(device.time, within_s))[2:])


def test_after_a_time_out_an_answer_that_cannot_be_old_comes_first(time):
    device = InOrder(time)
    link = linked(device)
    device.delays_s.extend([0.5])
    with pytest.raises(NoAnswer):
        poll(link, device)
    with pytest.raises(NoAnswer, match="old answer could be taken for a new one"):
        poll(link, device)
    assert poll(link, device) == device.polls == 3
    assert device.heard == [POLL, b"AVE\r", POLL]


def test_a_question_that_stays_unanswered_is_followed_by_another(time):
    device = InOrder(time, lost=[b"AVE\r"])
    link = linked(device, synchronised=False)
    assert poll(link, device, within_s=1.0) == device.polls
    assert device.heard == [b"AVE\r", b"A??M*\r", POLL]
    link.mark_suspect()
    poll(link, device)
    assert device.heard[3:] == [b"A??M*\r", POLL]


def test_where_every_question_is_unanswered_nothing_is_asked_before_a_long_silence(time):
    device = InOrder(time)
    link = linked(device)
    device.lost = [POLL, b"AVE\r", b"A??M*\r", b"A??D*\r"]
    with pytest.raises(NoAnswer):
        poll(link, device)
    with pytest.raises(NoAnswer, match=rf"3 questions are unanswered.*silence of {HOLD_S:g} s"):
        poll(link, device, within_s=2.0)
    device.lost = []
    heard = len(device.heard)
    with pytest.raises(NoAnswer):
        poll(link, device)
    assert len(device.heard) == heard
    time.sleep(HOLD_S)
    assert poll(link, device) == device.polls


def test_a_command_that_must_act_does_not_end_the_search(time):
    device = InOrder(time)
    link = linked(device)
    device.delays_s.extend([0.7])
    with pytest.raises(NoAnswer):
        poll(link, device)
    link.send_unheard(b"AE\r", Deadline(time, 0.1))
    assert poll(link, device, within_s=1.0) == device.polls


@pytest.mark.parametrize("first", [b"A D05 x\r", b"A 7\r"])
def test_a_question_whose_answer_was_not_understood_proves_nothing_when_asked_again(time, first):
    """What came may be an old answer, and the one to this question still on its way: it would pass for the next."""
    device = InOrder(time)
    link = linked(device)
    device.due.append((time.now_s() + 0.01, first))
    device.delays_s.append(0.3)
    try:
        link.exchange_line(b"AVE\r", Deadline(time, 0.2))
    except GarbledReply:
        pass
    else:
        link.mark_suspect()
    assert poll(link, device, within_s=1.0) == device.polls
    assert device.heard == [b"AVE\r", b"A??M*\r", POLL]


def test_an_old_answer_to_a_question_is_not_handed_out(time):
    device = InOrder(time)
    link = linked(device)
    device.due.append((time.now_s() + 0.01, b"A   10v20\r"))
    device.delays_s.append(0.02)
    with pytest.raises(GarbledReply, match="answers an earlier question"):
        poll(link, device)


@pytest.mark.parametrize("every_s", [0.02, 0.05, 0.15])
def test_a_stream_is_ended(time, every_s):
    device = InOrder(time, every_s=every_s)
    link = linked(device, synchronised=False)
    link.expect_stream(Stream(lambda line: line.startswith(b"@"), b"@@=A\r"))
    assert poll(link, device, within_s=1.0) == device.polls
    assert link.ended_stream


@pytest.mark.parametrize("late_s", [0.15, 0.25, 0.5, 1.0, 1.9, 3.0, 4.5, 6.0, 20.0])
@pytest.mark.parametrize("kinds", [1, 2, 3])
def test_a_device_that_is_always_late_is_never_believed_too_early(time, late_s, kinds):
    device = InOrder(time)
    link = linked(device, *(VERSION, MAKER, TABLE)[:kinds])
    device.delays_s = deque([late_s] * 1000)
    for _ in range(200):
        with suppress(InstrumentError):
            assert poll(link, device) == device.polls


@pytest.mark.parametrize("seed", range(40))
def test_answers_that_come_when_they_like_are_never_mistaken(time, seed):
    chance = random.Random(seed)
    device = InOrder(time)
    link = linked(device, *(VERSION, MAKER, TABLE)[: chance.randint(1, 3)])
    device.delays_s = deque(
        chance.choice([0.0, 0.0, 0.02, chance.uniform(0, 0.5), chance.uniform(0, HOLD_S)]) for _ in range(300)
    )
    right = 0
    for _ in range(150):
        try:
            assert poll(link, device, chance.choice([0.1, 0.2, 0.5])) == device.polls
            right += 1
        except InstrumentError:
            time.sleep(chance.choice([0.0, 0.05]))
    assert right > 5


@pytest.mark.parametrize("seed", range(20))
def test_a_question_that_is_set_anew_is_still_the_one_that_is_unanswered(time, seed):
    """Drivers set their questions again when they know more; whoever asked, the answer may be on its way."""
    chance = random.Random(seed)
    device = InOrder(time)
    link = linked(device)
    device.delays_s = deque(chance.choice([0.0, 0.02, chance.uniform(0, 0.9)]) for _ in range(300))
    right = 0
    for _ in range(150):
        # The same questions, made anew.
        link.resync_by(
            [Probe(old.request, lambda line, old=old: old.accepts(line)) for old in (VERSION, MAKER)]
        )
        try:
            assert poll(link, device, chance.choice([0.1, 0.2, 0.5])) == device.polls
            right += 1
        except InstrumentError:
            time.sleep(chance.choice([0.0, 0.05]))
    assert right > 5
