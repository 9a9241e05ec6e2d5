"""The ledger's record of a new run: the request, on which rig, by which programs, and what was simulated."""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.ledger.moment import now
from labctl.ledger.records import RunRecord, SimulatedHeights
from labctl.ledger.writer import LedgerWriter
from labctl.rig import Rig
from labctl.session.catalogue import package_of
from labctl.session.contract import Trial
from labctl.session.prepare import PreparedRun
from labctl.session.provenance import commit, versions


def simulated_heights(
    design: Design, trials: Sequence[Trial], config: RigConfig
) -> tuple[SimulatedHeights, ...]:
    """The simulator's heights of every pattern and pressure of a plan, as a run's record holds them.

    Raises:
        BadInput, LabError: a pattern that cannot be simulated.
    """
    points_mm = config.markers.points_mm()
    levels = dict.fromkeys((trial.pattern, psi) for trial in trials for psi in trial.pressures_psi)
    return tuple(
        SimulatedHeights(pattern, psi, _heights_mm(design, pattern, psi, points_mm))
        for pattern, psi in levels
    )


def record_new_run(
    ledger: LedgerWriter,
    prepared: PreparedRun,
    planned_trials: int,
    heights: tuple[SimulatedHeights, ...],
    rig: Rig,
    operator: str,
    note: str,
) -> RunRecord:
    """Put a new run into the ledger, with everything that it was made with."""
    return ledger.begin_run(
        RunRecord(
            number=0,
            protocol=prepared.protocol.name,
            begun=now(),
            request=prepared.request,
            planned_trials=planned_trials,
            design_name=prepared.design.name,
            design_source=prepared.design.source,
            design_text=prepared.design_text,
            rig_name=rig.config.name,
            rig=asdict(rig.config),
            simulated=rig.config.simulated,
            identities=rig.identities.by_instrument(),
            simulated_heights=heights,
            versions={**versions(), **package_of(prepared.protocol.name)},
            commit=commit(),
            operator=operator,
            note=note,
        )
    )


def _heights_mm(
    design: Design, pattern: str, pressure_psi: float, points_mm: np.ndarray
) -> tuple[float, ...]:
    # Imported only here: it takes a second, and bad input is refused before it.
    from labctl.simulation.simulate import simulate_pattern

    simulated = simulate_pattern(design, pattern, design.sheet.strain_at(pressure_psi))
    return tuple(simulated.points_mm(points_mm)[:, 2].tolist())
