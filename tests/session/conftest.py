"""Runs on doubles in virtual time: real bytes, a sheet without the simulator's cost, a ledger in a folder."""

import numpy as np
import pytest
from bowl import DESIGN
from virtual_rig import VirtualRig

from labctl.doubles.markers import DEFAULT_POINTS
from labctl.doubles.sheet import Relaxation
from labctl.ledger.records import SimulatedHeights
from labctl.ledger.writer import LedgerWriter
from labctl.rig import Rig
from labctl.session.continuation import record_continuation
from labctl.session.control_file import ControlFile
from labctl.session.engine import RunObserver, conduct
from labctl.session.prepare import PreparedRun
from labctl.session.record import record_new_run
from labctl.session.request import RunOptions, complete, plan
from labctl.session.run_stop import RunStop
from labctl.stop import OperatorStop
from protocols.five_trial import FIVE_TRIAL

MEASUREMENT = """
[measurement]
still_over = "1 s"
"""


def simulated_bowl(pattern, pressure_psi):
    rise_mm = tuple(float(np.hypot(point.x_mm - 70, point.y_mm - 70)) for point in DEFAULT_POINTS)
    return SimulatedHeights(pattern, pressure_psi, rise_mm)


class Laboratory:
    """A rig of doubles and a ledger; `run` conducts one run and keeps what was reported."""

    def __init__(self, folder, *faults, limits="", measurement=MEASUREMENT):
        self.folder = folder / "ledger"
        self.rig = VirtualRig(
            *faults,
            relaxation=Relaxation(fast_s=0.3, slow_s=1.0),
            change=lambda text: (
                text.replace("[limits]\n", f'[limits]\nsettle = "1 s"\ncapture = "0.5 s"\n{limits}')
                + measurement
            ),
        )
        self.config = self.rig.config
        self.operator = OperatorStop()
        self.design = DESIGN
        self.committed = []
        self.notes = []

    def prepared(self, protocol=FIVE_TRIAL, **options):
        options = {"patterns": ("rod",), "pressures_psi": (1.5,), "trials": 2, "attempts": 2, **options}
        return PreparedRun(
            protocol, complete(protocol, RunOptions(**options), DESIGN), DESIGN, "the design's text"
        )

    def run(self, prepared=None, *, run=None, change=lambda trials: trials, operator=None):
        """Conduct a run, or continue `run`; `change` may put steps of the test's own into the plan."""
        prepared = prepared or self.prepared()
        operator = operator or self.operator
        trials = change(plan(prepared.protocol, prepared.request, DESIGN, self.config))
        heights = tuple(simulated_bowl("rod", pressure) for pressure in prepared.request.pressures_psi)
        stop = RunStop(operator)
        observer = RunObserver(self.committed.append, lambda *_: None, self.notes.append, lambda *_: None)
        with LedgerWriter.open(self.folder, self.notes.append) as ledger:
            stop.watch(ControlFile(self.folder, self.rig.time))

            def register(rig):
                if run is not None:
                    return record_continuation(ledger, run, rig, "a test", "")
                return record_new_run(ledger, prepared, len(trials), heights, rig, "a test", "")

            rig = Rig(self.config, stop=stop, notify=self.notes.append, platform=self.rig.platform)
            return conduct(rig, register, trials, prepared.request.attempts, ledger, stop, observer)

    def assert_safe(self):
        self.rig.assert_safe()


@pytest.fixture
def laboratory(tmp_path):
    """Make laboratories; they are closed when the test ends."""
    opened = []

    def make(*faults, **settings):
        opened.append(Laboratory(tmp_path, *faults, **settings))
        return opened[-1]

    yield make
    for one in opened:
        one.rig.close()
