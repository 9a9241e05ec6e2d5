"""One inflation from a program of your own, measured as `labctl inflate` measures it."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from labctl.api.rigs import RigLike, configured, doubles, signals, to_standard_error
from labctl.config.quantity import duration_s, pressure_psi
from labctl.errors import LabError
from labctl.ledger.writer import LedgerWriter
from labctl.mocap.transfer_error import height_error
from labctl.next_command import note_given, noting
from labctl.rig.platform import SYSTEM
from labctl.session.control_file import ControlFile
from labctl.session.engine import RunFailed, RunObserver
from labctl.session.held import held
from labctl.session.measure import FinishedRun, Measuring, measure
from labctl.session.operator import default_operator
from labctl.session.prepare import prepare
from labctl.session.request import RunOptions, plan
from labctl.session.run_stop import RunStop
from labctl.session.temporary_ledger import temporary_ledger
from protocols.inflate import INFLATE


@dataclass(frozen=True, eq=False)
class Inflation:
    """What an inflation came to; SAFE was read back after it.

    `heights`: a row a measuring point, with `marker_id`, `x_mm` and `y_mm` (its place on the uninflated sheet, sheet
    frame), `height_mm` (above the uninflated sheet; missing where the marker was not seen), `simulated_mm` and `seen`
    (frames). `pressure_psi` is the mean gauge pressure while it was measured. `e_t_percent` compares the shapes alone
    (Parsa et al., RoboSoft 2023, equation 2), `mean_height_error_mm` the heights; None where too little was seen.
    `run` is the run's number in the ledger, None where none was kept. `simulated`: the rig was made of doubles.
    """

    heights: pd.DataFrame
    pressure_psi: float | None
    e_t_percent: float | None
    mean_height_error_mm: float | None
    run: int | None
    simulated: bool


def inflate(
    pattern: str,
    *,
    rig: RigLike | None = None,
    design: str | Path = "known",
    pressure: str = "3.9 psi",
    hold: str | None = None,
    ledger: str | Path | None = None,
    note: str = "",
    notify: Callable[[str], None] = to_standard_error,
) -> Inflation:
    """Jam a pattern, inflate the sheet, measure it, compare it with the simulation, vent, and read SAFE back.

    Args:
        pattern: the design's pattern to jam.
        rig: a rig.toml, or what `doubles` gave; doubles of its own where it is None.
        design: a shipped design's name, or a design file.
        pressure: gauge pressure to hold, with its unit.
        hold: how long to hold it at least before the sheet is measured, with its unit.
        ledger: folder of the ledger to keep the run in; nothing is kept where it is None.
        note: a line for the ledger.
        notify: gets each line that a person should see.

    Raises:
        BadInput: a pattern, design, pressure or rig that cannot be used; nothing was energised.
        LabError: it could not be measured; the rig is SAFE, and the message says why.
        Stopped: Ctrl-C; the rig is SAFE.
        Tripped: the supervisor vented the rig.
        Unsafe: SAFE could not be read back.
    """
    hold_s = None if hold is None else duration_s(hold)
    options = RunOptions((pattern,), (pressure_psi(pressure),), attempts=1, hold_s=hold_s)
    prepared = prepare(INFLATE, options, str(design))
    with ExitStack() as opened:
        opened.enter_context(noting())
        if isinstance(rig, (str, Path)):
            note_given("--rig", rig)
        if ledger is not None:
            note_given("--ledger", ledger)
        config = configured(rig if rig is not None else opened.enter_context(doubles(design)))
        planned = plan(prepared.protocol, prepared.request, prepared.design, config)
        stop = RunStop(opened.enter_context(signals()))
        folder = opened.enter_context(temporary_ledger()) if ledger is None else Path(ledger)
        writer = opened.enter_context(LedgerWriter.open(folder, notify))
        stop.watch(ControlFile(writer.folder, SYSTEM.scheduler))
        presence = opened.enter_context(held(config, stop, SYSTEM, notify))
        by = Measuring(
            config=config,
            writer=writer,
            stop=stop,
            platform=SYSTEM,
            presence=presence,
            observer=RunObserver(lambda _: None, lambda _, __: None, notify, lambda _, __: None),
            operator=default_operator(),
            note=note,
            kept=ledger is not None,
        )
        try:
            finished = measure(prepared, planned, by)
        except RunFailed as failed:
            if by.kept:
                raise
            # A run that was removed cannot be continued.
            raise LabError(failed.reason) from failed.__cause__
    return _inflation(finished, kept=ledger is not None)


def _inflation(finished: FinishedRun, *, kept: bool) -> Inflation:
    (level,) = finished.trials[-1].levels
    (simulated,) = finished.run.simulated_heights
    measured_mm = np.array(level.heights_mm, dtype=np.float64)
    error = height_error(measured_mm, simulated.heights_mm)
    points = finished.config.markers.points
    heights = pd.DataFrame(
        {
            "marker_id": [point.id for point in points],
            "x_mm": [point.x_mm for point in points],
            "y_mm": [point.y_mm for point in points],
            "height_mm": measured_mm,
            "simulated_mm": simulated.heights_mm,
            "seen": level.seen,
        }
    )
    return Inflation(
        heights=heights,
        pressure_psi=level.mean_psi,
        e_t_percent=level.e_t_percent,
        mean_height_error_mm=None if error is None else error.mean_mm,
        run=finished.run.number if kept else None,
        simulated=finished.run.simulated,
    )
