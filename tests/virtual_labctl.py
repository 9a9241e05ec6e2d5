"""`labctl` in the test's own process: alone, or against a rig of doubles in virtual time."""

import contextlib
import io
import os
import signal
from dataclasses import dataclass
from functools import cache, partial
from unittest.mock import patch

from virtual_rig import VirtualRig

from labctl.cli.main import run
from labctl.config.load import load_design
from labctl.doubles.in_process import REGULATOR_PORT
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.simulated_rig import simulated_shapes
from labctl.doubles.trace import row_of
from labctl.links.deadline import Deadline
from labctl.rig.platform import SYSTEM


@cache
def known_shapes():
    """The shapes of the design "known", made once for all rigs of a test process."""
    return simulated_shapes(DoublesSettings(load_design("known")), lambda _: None)


class SharedShapes:
    """Shapes that outlive a rig."""

    def ladder(self, jammed):
        return known_shapes().ladder(jammed)

    def close(self):
        pass


@dataclass
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str


def labctl_here(*arguments, platform=SYSTEM):
    """Run a command to its end in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run([str(argument) for argument in arguments], platform)
    return Ended(code, out.getvalue(), err.getvalue())


class _AtOnce:
    """Stands in for `NonBlockingOutput`: a thread of the machine's would come when the machine has time."""

    def __init__(self, write_out, heard):
        self._write_out, self._heard = write_out, heard

    def write(self, text):
        with contextlib.suppress(Exception):
            self._write_out(text)
        self._heard(text)

    def flush(self):
        pass

    def finish(self):
        pass


class VirtualLabctl:
    """A rig, the file `rig` that names it, and commands on it, one after the other.

    `faults` and `settings` are those of the doubles; `change` may rewrite the rig.toml.
    """

    def __init__(self, folder, *faults, change=lambda text: text, **settings):
        self.virtual = VirtualRig(
            *faults, design=load_design("known"), shapes=SharedShapes(), change=change, **settings
        )
        self.rig = folder / "virtual-rig.toml"
        self.rig.write_text(self.virtual.text)
        self._deeds = []
        self._failed = []

    @property
    def time(self):
        return self.virtual.time

    @property
    def plant(self):
        return self.virtual.plant

    def at(self, words, deed):
        """When the next command shows these words, do this, once."""
        self._deeds.append((words, deed))

    def when(self, condition, deed):
        """As soon as `condition` holds, do this, once."""

        def watch():
            while not condition():
                self.time.sleep(0.01)
            self._do(deed)

        self.time.start_thread(watch, "the test")

    def after(self, seconds, deed):
        """So many seconds from now, do this, once."""
        until_s = self.time.now_s() + seconds
        self.when(lambda: self.time.now_s() >= until_s, deed)

    def press_ctrl_c(self, number=signal.SIGINT):
        assert callable(signal.getsignal(number)), "the signal would end the test"
        os.kill(os.getpid(), number)

    def __call__(self, *arguments):
        """Run a command to its end, and let its guard come to its own."""
        output = partial(_AtOnce, heard=self._hear)
        with (
            patch("labctl.cli.output.NonBlockingOutput", output),
        ):
            ended = labctl_here(*arguments, platform=self.virtual.platform)
        for guard in self.virtual.guards:
            assert guard.ended(60), "the guard still waits for a program that is gone"
            ended.err += "".join(f"guard: {note}\n" for note in guard.notes)
        self.virtual.guards.clear()
        if self._failed:
            raise self._failed.pop()
        assert not self._deeds, f"never shown: {[words for words, _ in self._deeds]}; shown:\n{ended.err}"
        return ended

    def second(self, *arguments):
        """Run a command as in a second terminal, from a deed: the first command's own thread is busy meanwhile."""
        return labctl_here(*arguments, platform=self.virtual.platform)

    def leave_energised(self):
        """Somebody sets 2 psi over the wire, and goes."""
        wire = self.virtual.doubles.wires.open_serial(REGULATOR_PORT, 19200, "somebody's")
        wire.write(b"AS2.00\r", Deadline(self.time, 1.0))
        wire.read_some(100, Deadline(self.time, 1.0))
        self.time.sleep(10)
        wire.close()
        assert self.plant.state().pressure_psi > 1.5

    def last(self):
        """The plant's truth now, as a line of its trace."""
        return row_of(self.plant.state(), 0.0)

    def assert_untouched(self):
        """The instruments are as they were switched on: the exhaust was not even opened."""
        state = self.plant.state()
        assert (state.setpoint_psi, state.exhausting, state.coils) == (0, False, frozenset())
        assert self.plant.highest_psi == 0

    def close(self):
        self.virtual.close()
        assert self.time.failures == []

    def _hear(self, text):
        for words, deed in [each for each in self._deeds if each[0] in text]:
            self._deeds.remove((words, deed))
            self._do(deed)

    def _do(self, deed):
        """What the deed finds wrong is the test's to hear, not the command's."""
        try:
            deed()
        except AssertionError as error:
            self._failed.append(error)
