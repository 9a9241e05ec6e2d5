"""`labctl` in the test's own process, against a rig of doubles in virtual time."""

import contextlib
import io
import os
import signal
from dataclasses import dataclass
from functools import cache

from virtual_rig import VirtualRig

from labctl.cli.main import run
from labctl.cli.output import ProgressLine
from labctl.config.load import load_design
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.simulated_rig import simulated_shapes
from labctl.doubles.trace import row_of


@cache
def known_shapes():
    """The shapes of the design "known", made once for all rigs of a test process."""
    return simulated_shapes(DoublesSettings(load_design("known")), lambda _: None)


class _Shared:
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


class VirtualLabctl:
    """A rig, the file `rig` that names it, and commands on it; `at` does something when a command shows a step."""

    def __init__(self, folder, *faults, change=lambda text: text, **settings):
        self.virtual = VirtualRig(
            *faults, design=load_design("known"), shapes=_Shared(), change=change, **settings
        )
        self.rig = folder / "virtual-rig.toml"
        self.rig.write_text(self.virtual.text)
        self._deeds = []
        self.highest_psi = 0.0

    @property
    def time(self):
        return self.virtual.time

    @property
    def plant(self):
        return self.virtual.plant

    def at(self, step, deed):
        """When a command next shows a step with these words, do this, once."""
        self._deeds.append((step, deed))

    def press_ctrl_c(self, number=signal.SIGINT):
        os.kill(os.getpid(), number)

    def __call__(self, *arguments):
        """Run a command to its end; a command that works on a rig works on this one."""
        out, err = io.StringIO(), io.StringIO()
        show = ProgressLine.show

        def shown(line, step, detail=""):
            show(line, step, detail)
            for deed in [each for each in self._deeds if each[0] in f"{step} {detail}"]:
                self._deeds.remove(deed)
                deed[1]()

        ProgressLine.show = shown
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                code = run([str(argument) for argument in arguments], self.virtual.platform)
        finally:
            ProgressLine.show = show
        # A guard that was left to vent does so now.
        self.time.sleep(30)
        notes = [f"guard: {note}" for guard in self.virtual.guards for note in guard.notes]
        return Ended(code, out.getvalue(), "\n".join([err.getvalue(), *notes]))

    def last(self):
        """The plant's truth now, as a line of its trace."""
        return row_of(self.plant.state(), 0.0)

    def close(self):
        self.virtual.close()
        assert self.time.failures == []
