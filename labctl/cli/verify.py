"""`labctl verify RUN`: do the raw files still give the numbers of the ledger?"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.ledgers import print_notice
from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import banner, counted, emit_json

if TYPE_CHECKING:
    from labctl.ledger.records import RunRecord
    from labctl.verification.differences import Difference
    from labctl.verification.verify_run import TrialVerification, Verification

# Another machine, or another version of what computes, rounds otherwise; a different design is off by far more.
SIMULATION_TOLERANCE_MM = 1e-3
_MOST_SHOWN = 5
# The programs that numbers depend on.
_DERIVING = ("labctl", "python", "numpy", "scipy")


@click.command()
@click.argument("name", metavar="RUN")
@ledger_option
@json_option
def verify(name: str, ledger_folder: Path, as_json: bool) -> int:
    """Compute every number of a run again from its raw recordings, and hash these again.

    RUN is a run's number, or "last". The simulated heights are computed again too. Exit code 0: all agree, measured
    numbers to the last bit; 1: something does not, and is named.
    """
    from labctl.ledger.ledger import Ledger
    from labctl.verification.verify_run import verify_run

    with Ledger.open(ledger_folder, print_notice) as ledger:
        run = ledger.find(name)
        verification = verify_run(ledger, run)
    simulation = _simulate_again(run)
    agrees = verification.agrees and simulation.agrees
    if as_json:
        emit_json(_for_machines(run, verification, simulation, agrees))
    else:
        banner(run.simulated)
        click.echo(f"run {run.number}: {run.protocol}, design {run.design_name}")
        for line in (
            *_trial_lines(verification.trials),
            *_summary_lines(verification.summary),
            *simulation.lines(),
            *_unrecorded_lines(verification.unrecorded),
        ):
            click.echo(line)
        if verification.differences:
            click.echo(
                f"the recorded numbers were made by {_makers(run)}; another version may derive otherwise"
            )
        click.echo(_last_line(run, verification, simulation))
    return 0 if agrees else 1


@dataclass(frozen=True)
class SimulatedAgain:
    """The simulated heights of a run, computed again: how many shapes, the greatest difference, what went wrong."""

    shapes: int
    greatest_mm: float
    problems: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Nothing went wrong, and no height is further off than rounding takes it."""
        return not self.problems and self.greatest_mm <= SIMULATION_TOLERANCE_MM

    def lines(self) -> Iterator[str]:
        """The lines for a person."""
        if self.problems:
            yield "simulated heights: DISAGREE"
            yield from (f"    {problem}" for problem in self.problems)
        elif self.shapes and not self.greatest_mm:
            yield f"simulated heights: the same again, to the last bit ({counted(self.shapes, 'shape')})"
        elif self.shapes:
            judged = "agree" if self.agrees else "DISAGREE"
            yield (
                f"simulated heights: {judged}, {self.greatest_mm:.2g} mm apart at most; "
                f"{SIMULATION_TOLERANCE_MM:g} mm may come of another machine or version"
            )


def _simulate_again(run: "RunRecord") -> SimulatedAgain:
    import numpy as np

    from labctl.config.load import design_from_text
    from labctl.errors import LabError
    from labctl.simulation.simulate import simulate_pattern
    from sim.warm import compile_kernels

    if run.simulated_heights:
        compile_kernels(print_notice)
    points_mm = np.array([(point.x_mm, point.y_mm) for point in run.points])
    greatest_mm = 0.0
    problems: list[str] = []
    for stored in run.simulated_heights:
        pattern, pressure_psi = stored.pattern, stored.pressure_psi
        try:
            design = design_from_text(run.design_text, run.design_source)
            simulated = simulate_pattern(design, pattern, design.sheet.strain_at(pressure_psi))
            apart_mm = simulated.points_mm(points_mm)[:, 2] - np.array(stored.heights_mm)
        except LabError as error:
            problems.append(f"{pattern} at {pressure_psi:g} psi cannot be simulated again: {error}")
        else:
            greatest_mm = max(greatest_mm, float(np.abs(apart_mm).max()))
    return SimulatedAgain(len(run.simulated_heights), greatest_mm, tuple(problems))


def _trial_lines(trials: "Sequence[TrialVerification]") -> Iterator[str]:
    for trial in trials:
        head = f"trial {trial.number}, attempt {trial.attempt} ({trial.outcome})"
        if not trial.agrees:
            yield f"{head}: DISAGREES"
            yield from (f"    {problem}" for problem in trial.problems)
            yield from _difference_lines(trial.differences)
        elif trial.recomputed:
            yield f"{head}: {counted(len(trial.files), 'file')} as recorded, every number the same again"
        else:
            files = (
                f"{counted(len(trial.files), 'file')} as recorded" if trial.files else "nothing was recorded"
            )
            yield f"{head}: {files}; there are no numbers to recompute"
        yield from (f"    {note}" for note in trial.notes)


def _summary_lines(summary: "Sequence[Difference] | None") -> Iterator[str]:
    if summary is None:
        yield "summary: none is recorded, since the run is not finished"
    elif summary:
        yield "summary: DISAGREES"
        yield from _difference_lines(summary)
    else:
        yield "summary: every number the same again"


def _unrecorded_lines(files: "Sequence[str]") -> Iterator[str]:
    if files:
        yield "of no recorded attempt, left by an end within a trial (they count nowhere):"
        yield from (f"    {file}" for file in files)


def _difference_lines(differences: "Sequence[Difference]") -> Iterator[str]:
    yield from (f"    {difference.describe()}" for difference in differences[:_MOST_SHOWN])
    if len(differences) > _MOST_SHOWN:
        yield f"    and {counted(len(differences) - _MOST_SHOWN, 'more number')} (--json lists all)"


def _makers(run: "RunRecord") -> str:
    programs = [f"{program} {run.versions[program]}" for program in _DERIVING if program in run.versions]
    return ", ".join([*programs, f"commit {run.commit or 'unknown'}"])


def _last_line(run: "RunRecord", verification: "Verification", simulation: SimulatedAgain) -> str:
    wrong = [
        f"trial {trial.number}, attempt {trial.attempt}" for trial in verification.trials if not trial.agrees
    ]
    if verification.summary:
        wrong.append("the summary")
    if not simulation.agrees:
        wrong.append("the simulated heights")
    if wrong:
        return f"run {run.number} DOES NOT AGREE with its recording: {'; '.join(wrong)}"
    files = sum(len(trial.files) for trial in verification.trials)
    attempts = counted(len(verification.trials), "attempt")
    return f"run {run.number}: all agree ({attempts}, {counted(files, 'raw file')})"


def _for_machines(
    run: "RunRecord", verification: "Verification", simulation: SimulatedAgain, agrees: bool
) -> dict[str, Any]:
    return {
        "run": run.number,
        "simulated": run.simulated,
        "agrees": agrees,
        "trials": [
            {
                "number": trial.number,
                "attempt": trial.attempt,
                "outcome": trial.outcome,
                "agrees": trial.agrees,
                "files": trial.files,
                "recomputed": trial.recomputed,
                "problems": trial.problems,
                "differences": trial.differences,
                "notes": trial.notes,
            }
            for trial in verification.trials
        ],
        "unrecorded_files": verification.unrecorded,
        "summary": verification.summary,
        "simulated_heights": {
            "agree": simulation.agrees,
            "shapes": simulation.shapes,
            "greatest_difference_mm": simulation.greatest_mm,
            "problems": simulation.problems,
        },
    }
