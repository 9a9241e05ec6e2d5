"""Runs on doubles in this process: real bytes, a sheet without the simulator's cost, a ledger in a folder."""

import numpy as np
import pytest
from bowl import DESIGN, Bowl

from labctl.clock import WallClock
from labctl.config.load import rig_from_text
from labctl.doubles.faults import parse_faults
from labctl.doubles.markers import DEFAULT_POINTS
from labctl.doubles.serve import Doubles
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.sheet import Relaxation
from labctl.ledger.writer import LedgerWriter
from labctl.rig import Rig
from labctl.session.engine import Listener, conduct
from labctl.session.inbox import Inbox
from labctl.session.prepare import PreparedRun
from labctl.session.record import begin_run
from labctl.session.request import RunOptions, complete, plan
from labctl.session.resume import go_on
from labctl.session.run_stop import RunStop
from labctl.stop import OperatorStop
from protocols.five_trial import FIVE_TRIAL

SPEED = 20.0
MEASUREMENT = """
[measurement]
still_over = "1 s"
"""


def simulated_bowl(pattern, pressure_psi):
    rise_mm = [float(np.hypot(point.x_mm - 70, point.y_mm - 70)) for point in DEFAULT_POINTS]
    return {"pattern": pattern, "pressure_psi": pressure_psi, "heights_mm": rise_mm}


class Laboratory:
    """A rig of doubles and a ledger; `run` conducts one run and keeps what was told."""

    def __init__(self, folder, *faults, limits="", measurement=MEASUREMENT, speed=SPEED):
        self.folder = folder / "ledger"
        self.doubles = Doubles(
            DoublesSettings(
                DESIGN,
                speed=speed,
                faults=parse_faults(faults),
                relaxation=Relaxation(fast_s=0.3, slow_s=1.0),
            ),
            shapes=Bowl(),
        )
        text = self.doubles.rig_toml()
        text = text.replace("[limits]\n", f'[limits]\nsettle = "1 s"\ncapture = "0.5 s"\n{limits}')
        self.rig_text = text + measurement
        self.config = rig_from_text(self.rig_text, "rig.toml")
        self.operator = OperatorStop()
        self.design = DESIGN
        self.told = []
        self.notes = []

    def prepared(self, protocol=FIVE_TRIAL, **asked):
        asked = {"patterns": ("rod",), "pressures_psi": (1.5,), "trials": 2, "attempts": 2, **asked}
        return PreparedRun(
            protocol, complete(protocol, RunOptions(**asked), DESIGN), DESIGN, "the design's text"
        )

    def run(self, prepared=None, *, run=None, change=lambda trials: trials, operator=None):
        """Conduct a run, or go on with `run`; `change` may put steps of the test's own into the plan."""
        prepared = prepared or self.prepared()
        operator = operator or self.operator
        trials = change(plan(prepared.protocol, prepared.request, DESIGN, self.config))
        heights = tuple(simulated_bowl("rod", pressure) for pressure in prepared.request.pressures_psi)
        stop = RunStop(operator)
        listener = Listener(self.told.append, lambda *_: None, self.notes.append, lambda *_: None)
        with LedgerWriter.open(self.folder, self.notes.append) as ledger:
            stop.listen_to(Inbox(self.folder, WallClock()))

            def register(rig):
                if run is not None:
                    return go_on(ledger, run, rig, "a test", "")
                return begin_run(ledger, prepared, len(trials), heights, rig, "a test", "")

            rig = Rig(self.config, stop=stop, tell=self.notes.append)
            return conduct(rig, register, trials, prepared.request.attempts, ledger, stop, listener)

    def assert_safe(self):
        state = self.doubles.plant.state()
        assert state.setpoint_psi == 0
        assert state.exhausting
        assert state.pressure_psi < 0.3
        assert not state.coils


@pytest.fixture
def laboratory(tmp_path):
    """Make laboratories; they are closed when the test ends."""
    opened = []

    def make(*faults, **settings):
        opened.append(Laboratory(tmp_path, *faults, **settings))
        return opened[-1]

    yield make
    for one in opened:
        one.doubles.close()
