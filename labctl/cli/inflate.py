"""`labctl inflate`: one run of the protocol "inflate", from a pattern's name to a measured shape and back to SAFE."""

from collections.abc import Sequence
from contextlib import nullcontext
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from labctl.cli.options import design_option, json_option, ledger_option, rig_option
from labctl.cli.output import (
    banner,
    counted,
    emit_json,
    number,
    print_look_at_it,
    table,
    unit_json,
    unit_line,
)
from labctl.errors import BadInput, LabError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from labctl.cli.run.options import SessionOptions
    from labctl.measurement.result import DoubtedPoint, LevelResult
    from labctl.session.measure import FinishedRun
    from labctl.session.prepare import PreparedRun


@click.command()
@click.option("--pattern", required=True, help="Pattern of the design to jam.")
@click.option(
    "--pressure", "pressure_text", default="3.9 psi", show_default=True, help="Gauge pressure to hold."
)
@click.option(
    "--hold", "hold_text", help="How long to hold it at least before the sheet is measured, as in '30 s'."
)
@click.option("--keep", is_flag=True, help="Record the measurement in the ledger, as a run.")
@design_option
@rig_option
@ledger_option
@json_option
@click.pass_context
def inflate(
    ctx: click.Context,
    pattern: str,
    pressure_text: str,
    hold_text: str | None,
    keep: bool,
    design_name: str,
    rig_path: Path | None,
    ledger_folder: Path,
    as_json: bool,
) -> None:
    """Jam a pattern, inflate the sheet, measure it, compare with the simulation, vent.

    Ctrl-C at any moment ends in SAFE. Exit code 0: the measurement is good and SAFE was read back.
    """
    from labctl.cli.rigs import rig_to_be
    from labctl.cli.run.options import SessionOptions
    from labctl.config.quantity import duration_s, pressure_psi
    from labctl.session.prepare import prepare
    from labctl.session.request import RunOptions, plan
    from protocols.inflate import INFLATE

    if not keep and ctx.get_parameter_source("ledger_folder") is ParameterSource.COMMANDLINE:
        raise BadInput("--ledger is where --keep puts the run: give both, or neither")
    hold_s = None if hold_text is None else duration_s(hold_text)
    run_options = RunOptions((pattern,), (pressure_psi(pressure_text),), attempts=1, hold_s=hold_s)
    prepared = prepare(INFLATE, run_options, design_name)
    plan(prepared.protocol, prepared.request, prepared.design, rig_to_be(rig_path, prepared.design))

    options = SessionOptions(rig_path, as_json)
    finished = _measure(prepared, design_name, ledger_folder if keep else None, options)
    if as_json:
        emit_json(_for_machines(finished, kept=keep))
        return
    _for_people(finished)
    if keep:
        print_look_at_it(finished.run.number)


def _measure(
    prepared: "PreparedRun", design_name: str, kept_in: Path | None, options: "SessionOptions"
) -> "FinishedRun":
    """The finished run, in the ledger `kept_in` or, where that is None, in one that is removed by now."""
    # The instruments' side takes a second to import: bad input is refused before.
    from labctl.cli.run.session import conduct_session, open_session
    from labctl.session.engine import RunFailed
    from labctl.session.temporary_ledger import temporary_ledger

    ledger = temporary_ledger() if kept_in is None else nullcontext(kept_in)
    try:
        with open_session(ledger, options) as session:
            return conduct_session(
                prepared, design_name, options, session, quiet=True, kept=kept_in is not None
            )
    except RunFailed as failed:
        if kept_in is not None:
            raise
        # A run that was removed cannot be continued.
        raise LabError(failed.reason) from failed.__cause__


def _for_machines(finished: "FinishedRun", *, kept: bool) -> dict[str, Any]:
    from labctl.mocap.transfer_error import height_error

    level = _level(finished)
    apart = height_error(_heights_mm(level.heights_mm), _simulated_mm(finished))
    return {
        "simulated": finished.run.simulated,
        **unit_json(finished.config.regulator),
        "pattern": finished.planned[0].pattern,
        "pressure_psi": _rounded(level.mean_psi, 4),
        "heights_mm": _heights_mm(level.heights_mm).round(3),
        "measuring_points": [
            {"marker": point.id, "x_mm": point.x_mm, "y_mm": point.y_mm}
            for point in finished.config.markers.points
        ],
        "transfer_error_percent": _rounded(level.e_t_percent, 3),
        "mean_height_error_mm": None if apart is None else round(apart.mean_mm, 4),
        "mean_height_difference_mm": None if apart is None else round(apart.difference_mm, 4),
        "safe": finished.safe is not None and finished.safe.safe,
        "simulated_heights_mm": _simulated_mm(finished).round(3),
        "points": level.points_compared,
        "occluded_samples": _occluded(level),
        "left_out_samples": list(level.left_out),
        "doubted": [
            {"marker": each.marker_id, "point": each.point, "window": each.window, "why": each.why}
            for each in _doubted(finished)
        ],
        "frames": level.frames,
        "pressure_range_psi": (level.lowest_psi, level.highest_psi),
        "channels_on": _channels_on(finished),
        **({"run": finished.run.number} if kept else {}),
    }


def _for_people(finished: "FinishedRun") -> None:
    from labctl.mocap.transfer_error import height_error

    level, config = _level(finished), finished.config
    what = f"design {finished.run.design_name}, pattern {finished.planned[0].pattern}"
    banner(config.simulated)
    unit_line(config.regulator)
    click.echo(f"{config.name}: {what}, channels {', '.join(map(str, _channels_on(finished)))} on")
    if level.mean_psi is not None:
        click.echo(
            f"held {level.mean_psi:.2f} psi ({level.lowest_psi:.2f} to {level.highest_psi:.2f}) while measuring"
        )
    click.echo("")
    heights_mm, simulated_mm = _heights_mm(level.heights_mm), _simulated_mm(finished)
    table(
        ("marker", "x mm", "y mm", "measured mm", "simulated mm", "seen", "left out", "occluded"),
        [
            (
                str(point.id),
                f"{point.x_mm:g}",
                f"{point.y_mm:g}",
                number(heights_mm[row]),
                number(simulated_mm[row]),
                str(level.seen[row]),
                str(level.left_out[row] if level.left_out else 0),
                str(_occluded(level)[row]),
            )
            for row, point in enumerate(config.markers.points)
        ],
    )
    click.echo("")
    heights = zip(config.markers.points, heights_mm, strict=True)
    doubted = _doubted(finished)
    known = {each.marker_id for each in doubted}
    unmeasured = [str(point.id) for point, height_mm in heights if isnan(height_mm) and point.id not in known]
    for each in doubted:
        click.echo(each.describe())
    if unmeasured:
        click.echo(f"not measured, too rarely seen: markers {', '.join(unmeasured)}")
    if level.e_t_percent is not None:
        over = counted(level.points_compared, "point")
        click.echo(
            f"transfer error e_t {level.e_t_percent:.1f} % over {over} (shapes alone: each side is divided by\n"
            "its own greatest height)"
        )
    apart = height_error(heights_mm, simulated_mm)
    if apart is not None:
        click.echo(
            f"mean height error {apart.mean_mm:.2f} mm; measured less simulated "
            f"{apart.difference_mm:+.2f} mm on average"
        )
    if finished.safe is not None:
        click.echo(finished.safe.describe())


def _occluded(level: "LevelResult") -> list[int]:
    """In how many frames each marker was not shown."""
    left_out = level.left_out or (0,) * len(level.seen)
    return [level.frames - seen - out for seen, out in zip(level.seen, left_out, strict=True)]


def _doubted(finished: "FinishedRun") -> "tuple[DoubtedPoint, ...]":
    """The points that were there and are not taken for seen."""
    result = finished.trials[-1].result
    return () if result is None else result.doubted_at(_level(finished))


def _level(finished: "FinishedRun") -> "LevelResult":
    """The only level of the only good trial."""
    (level,) = finished.trials[-1].levels
    return level


def _simulated_mm(finished: "FinishedRun") -> "NDArray[np.float64]":
    (level,) = finished.run.simulated_heights
    return _heights_mm(level.heights_mm)


def _heights_mm(heights_mm: "Sequence[float | None]") -> "NDArray[np.float64]":
    """NaN where there is none."""
    import numpy as np

    return np.array(heights_mm, dtype=np.float64)


def _channels_on(finished: "FinishedRun") -> list[int]:
    """The channels that read back on: the step that jams has seen to it that no other was."""
    dump = finished.config.valves.dump_channel
    steps = finished.planned[0].checklist.steps
    on = frozenset().union(*(step.channels for step in steps), () if dump is None else {dump})
    return sorted(on)


def _rounded(value: float | None, decimals: int) -> float | None:
    return None if value is None else round(value, decimals)
