"""A run into a folder of its own: tables as CSV or Parquet with its raw files, or its motion as C3D."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pandas as pd

from labctl.atomic_files import atomic_folder
from labctl.errors import BadInput
from labctl.export.c3d_file import write_c3d
from labctl.export.motion import motion_of
from labctl.export.run_tables import meaning, run_tables
from labctl.instruments.readings import PressureSamples
from labctl.ledger.ledger import Ledger
from labctl.ledger.raw.check import as_recorded
from labctl.ledger.raw.recording import read_frames, read_pressures
from labctl.ledger.records import RunRecord, TrialRecord
from labctl.measurement.recording import lay_out

Format = Literal["csv", "parquet", "c3d"]
_LONGEST_TEXT = 120


@dataclass(frozen=True)
class Exported:
    """What was written: the folder and its files' names; `left_out` names the trials without a file, and why."""

    folder: Path
    files: tuple[str, ...]
    left_out: tuple[str, ...]


def export_run(ledger: Ledger, run: RunRecord, kind: Format, folder: Path) -> Exported:
    """Write a run into a new folder, which is complete or not there.

    Raises:
        BadInput: something is there already, it cannot be written, or there is nothing to write.
        LabError: a raw file is missing, or is not what was recorded.
    """
    write = {"csv": _write_csv, "parquet": _write_parquet, "c3d": _write_motion}[kind]
    with atomic_folder(folder) as unfinished:
        left_out = write(ledger, run, unfinished)
        files = sorted(str(path.relative_to(unfinished)) for path in unfinished.rglob("*") if path.is_file())
        if not files:
            why = "; ".join(left_out) or "it has no trial yet"
            raise BadInput(f"run {run.number}: there is nothing to write as {kind}: {why}")
    return Exported(folder, tuple(files), tuple(left_out))


def _write_csv(ledger: Ledger, run: RunRecord, folder: Path) -> list[str]:
    tables = _tables(ledger, run)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    _write_readme(folder, run, {f"{name}.csv": table for name, table in tables.items()})
    return []


def _write_parquet(ledger: Ledger, run: RunRecord, folder: Path) -> list[str]:
    tables = _tables(ledger, run)
    for name, table in tables.items():
        table.to_parquet(folder / f"{name}.parquet", index=False)
    for trial in ledger.trials(run.number):
        for file in trial.raw.values():
            target = folder / "raw" / Path(file.path).name
            target.parent.mkdir(exist_ok=True)
            shutil.copyfile(as_recorded(ledger.folder, file), target)
    _write_readme(folder, run, {f"{name}.parquet": table for name, table in tables.items()})
    return []


def _write_motion(ledger: Ledger, run: RunRecord, folder: Path) -> list[str]:
    left_out = []
    for trial in ledger.trials(run.number):
        name = f"trial {trial.number}, attempt {trial.attempt}"
        if not {"frames", "pressures"} <= trial.raw.keys():
            left_out.append(f"{name}: nothing was recorded")
            continue
        frames = read_frames(as_recorded(ledger.folder, trial.raw["frames"]))
        recording = lay_out(frames, _read_pressures(ledger)(trial), run.basis(trial.pattern))
        if isinstance(recording, str):
            left_out.append(f"{name}: {recording}")
            continue
        motion = motion_of(recording, trial.windows)
        if not motion.in_sheet_frame:
            left_out.append(f"{name}: its baseline fixes no sheet frame; written in the instrument's frame")
        write_c3d(folder, f"trial-{trial.number:02d}-{trial.attempt}", motion, _c3d_labels(run, trial))
    return left_out


def _tables(ledger: Ledger, run: RunRecord) -> dict[str, pd.DataFrame]:
    return run_tables(run, ledger.trials(run.number), _read_pressures(ledger))


def _read_pressures(ledger: Ledger) -> Callable[[TrialRecord], PressureSamples]:
    return lambda trial: read_pressures(as_recorded(ledger.folder, trial.raw["pressures"]))


def _c3d_labels(run: RunRecord, trial: TrialRecord) -> dict[str, str]:
    """Where a C3D file comes from; the format holds short ASCII texts."""
    labels = {
        "RUN": str(run.number),
        "PROTOCOL": run.protocol,
        "DESIGN": run.design_name,
        "RIG": f"{run.rig_name}{', SIMULATED' if run.simulated else ''}",
        "TRIAL": f"{trial.number}, attempt {trial.attempt}",
        "OUTCOME": trial.outcome,
        "PLACEMENT": trial.placement,
        "PATTERN": trial.pattern,
        "BEGUN": trial.begun.wall,
    }
    return {name: text.encode("ascii", "replace").decode()[:_LONGEST_TEXT] for name, text in labels.items()}


def _write_readme(folder: Path, run: RunRecord, tables: Mapping[str, pd.DataFrame]) -> None:
    simulated = " SIMULATED RIG: no real instrument was connected." if run.simulated else ""
    lines = [
        f"Run {run.number}: {run.protocol}, design {run.design_name}, begun {run.begun.wall}.{simulated}"
    ]
    lines.append("An empty cell, or a missing value, was not measured or could not be had.")
    for name, table in tables.items():
        wide = max(map(len, table.columns), default=0)
        lines += ["", f"{name} ({len(table)} rows)"]
        lines += [f"  {column:<{wide}}  {meaning(column)}" for column in table.columns]
    (folder / "README.txt").write_text("\n".join([*lines, ""]), encoding="utf-8", errors="replace")
