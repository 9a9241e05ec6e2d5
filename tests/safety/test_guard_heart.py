"""What the guard makes of the program's bytes, and of their absence."""

import pytest

from labctl.safety.guard import BEAT, ENERGISED, SAFE, STAND_DOWN
from labctl.safety.guard_heart import HEARTBEAT_TIMEOUT_S, watch


class Program:
    """Sends each of its bytes, or is silent where there is None; then it is gone."""

    def __init__(self, *sent):
        self._sent = list(sent)
        self.patience_s = []
        self.hangs = 0

    def receive(self, timeout_s):
        self.patience_s.append(timeout_s)
        data = self._sent.pop(0) if self._sent else b""
        # Who is waited for without an end is never found silent.
        assert data is not None or timeout_s is not None
        return data

    def hang(self):
        self.hangs += 1

    def is_vented(self):
        return watch(self.receive, self.hang)


def test_a_program_that_is_gone_is_vented():
    program = Program(ENERGISED + BEAT)
    assert program.is_vented()
    assert program.hangs == 0


@pytest.mark.parametrize(
    "sent", [(STAND_DOWN,), (ENERGISED, BEAT, SAFE + STAND_DOWN), (ENERGISED + STAND_DOWN,)]
)
def test_a_program_that_stands_the_guard_down_is_left_alone(sent):
    assert not Program(*sent).is_vented()


def test_missing_beats_while_energised_are_a_hang():
    program = Program(ENERGISED, BEAT, None)
    assert program.is_vented()
    assert program.hangs == 1
    assert program.patience_s == [None, HEARTBEAT_TIMEOUT_S, HEARTBEAT_TIMEOUT_S]


def test_nobody_waits_for_beats_in_safe():
    program = Program(ENERGISED, SAFE, BEAT)
    program.is_vented()
    assert program.patience_s == [None, HEARTBEAT_TIMEOUT_S, None, None]
