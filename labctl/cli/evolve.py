"""`labctl evolve`: search for fiber layouts that take several shapes."""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from labctl.cli.evolve_progress import Progress
from labctl.cli.evolve_show import pick, show, tell_runs
from labctl.cli.interrupts import stop_on_signals
from labctl.cli.rigs import design_option, json_option
from labctl.errors import BadInput, Stopped
from labctl.stop import StopRequest

if TYPE_CHECKING:
    from evolve.workers.pool import Pool
    from labctl.evolution.choices import Choices
    from labctl.evolution.running import PlannedRun

GENERATIONS = 300
# The options that say what is searched for and how; all others say where it runs and what is told.
_CHOICES = (
    "targets",
    "design_name",
    "representation",
    "population",
    "fibers_per_face",
    "min_length",
    "rig_path",
    "scoring",
    "surface",
    "alignment",
    "rates",
    "without",
    "crowding",
    "preset",
    "seed",
    "seeds",
)


@dataclass(frozen=True)
class _Wanted:
    """What the command line asks for."""

    targets: str | None
    out_path: Path | None
    seed: int
    seeds: str | None
    generations: int
    population: int
    representation: str
    fibers_per_face: int
    min_length: str
    rig_path: Path | None
    scoring: str
    surface: str
    alignment: str
    rates: str | None
    without: tuple[str, ...]
    crowding: str
    preset: str | None
    workers: int | None
    cluster: str | None
    resume: bool
    design_name: str


@click.group(invoke_without_command=True)
@click.option(
    "--targets", help="The shapes: cylinder,sphere or saddle,monkey-saddle, or as simulate --target."
)
@click.option("--out", "out_path", type=click.Path(path_type=Path), help="The run's folder, new or empty.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of all random numbers."
)
@click.option("--seeds", help="Several independent runs, one after the other: 1,2,3.")
@click.option(
    "--generations", type=click.IntRange(min=1), default=GENERATIONS, show_default=True, help="In all."
)
@click.option(
    "--population", type=click.IntRange(min=2), default=100, show_default=True, help="Layouts in each."
)
@click.option(
    "--representation",
    type=click.Choice(["shared", "exclusive"]),
    default="shared",
    show_default=True,
    help="A fiber may serve several shapes, or one only, as published.",
)
@click.option(
    "--fibers-per-face",
    type=click.IntRange(min=1),
    default=6,
    show_default=True,
    help="At most, of all shapes together.",
)
@click.option("--min-length", default="60 mm", show_default=True, help="The shortest fiber.")
@click.option(
    "--rig",
    "rig_path",
    type=click.Path(path_type=Path),
    help="The rig whose valves there are.  [default: a board of 32]",
)
@click.option(
    "--scoring",
    type=click.Choice(["default", "published"]),
    default="default",
    show_default=True,
    help="e_s at rest over all columns, or as published: whole mm, bottom layer, published protocol.",
)
@click.option(
    "--surface",
    type=click.Choice(["top", "bottom", "mid"]),
    default="top",
    show_default=True,
    help="The surface that is scored.",
)
@click.option(
    "--alignment",
    type=click.Choice(["none", "offset"]),
    default="none",
    show_default=True,
    help="Score heights as they stand, or shifted by the median difference.",
)
@click.option("--rates", help="The operators' shares: near=0.5,count=0.2; others are off.")
@click.option("--without", multiple=True, help="Switch an operator off; may be repeated.")
@click.option(
    "--crowding",
    type=click.Choice(["contribution", "twins"]),
    default="contribution",
    show_default=True,
    help="Who goes when the front alone is too many: the least hypervolume, or near-twins, as published.",
)
@click.option(
    "--preset",
    type=click.Choice(["published"]),
    help="All of the paper's way: exclusive, its operators, crowding and scoring.",
)
@click.option("--workers", type=click.IntRange(min=1), help="Processes.  [default: one for each core]")
@click.option("--cluster", help="Simulate on a Dask cluster: its scheduler's address, tcp://HOST:8786.")
@click.option("--resume", is_flag=True, help="Go on with the run in --out; --generations may be more.")
@design_option
@json_option
@click.pass_context
def evolve(context: click.Context, as_json: bool, **options: Any) -> None:  # noqa: ANN401 - click's values
    """Search for fiber layouts that reach several shapes from one sheet.

    Each generation is kept in the run's folder; Ctrl-C, or worse, loses the one in progress only.
    """
    if context.invoked_subcommand is not None:
        if given := [name for name in options if _is_given(name)]:
            raise click.UsageError(
                f"{_flag(given[0])} goes with the search itself, not with {context.invoked_subcommand}"
            )
        return
    wanted = _Wanted(**options)
    if wanted.out_path is None:
        raise click.UsageError("name the run's folder: --out runs/a")
    if wanted.cluster is not None and wanted.workers is not None:
        raise click.UsageError("--workers are of this machine, --cluster is another: give one of them")

    from labctl.evolution.telling_errors import lab_errors
    from sim.warm import compile_kernels

    with stop_on_signals(doing="stopping at the last finished generation") as stop, lab_errors():
        planned = _planned(wanted, wanted.out_path)
        physics = planned[0].settings.problem.physics
        compile_kernels(_say, physics.solver, physics.precision)
        _search(planned, _pool(planned, wanted), stop, wanted.out_path, as_json)
    tell_runs(wanted.out_path, as_json, published=False)


evolve.add_command(show)
evolve.add_command(pick)


def _planned(wanted: _Wanted, out_path: Path) -> "list[PlannedRun]":
    from labctl.evolution.choices import settings_of
    from labctl.evolution.running import begin_runs, resume_runs

    if wanted.resume:
        planned = resume_runs(out_path, wanted.generations if _is_given("generations") else None)
        _check_same(wanted, planned)
        return planned
    if wanted.targets is None:
        raise click.UsageError("name the shapes: --targets cylinder,sphere")
    choices = _choices(wanted)
    first = settings_of(choices, _seeds(wanted)[0], _compile)
    return begin_runs(out_path, [replace(first, seed=seed) for seed in _seeds(wanted)], wanted.generations)


def _choices(wanted: _Wanted) -> "Choices":
    from evolve.variation import DEFAULT_RATES, OPERATORS
    from labctl.config.quantity import LENGTH, to_unit
    from labctl.evolution.choices import PUBLISHED, Choices, parse_rates

    try:
        min_length_mm = to_unit(wanted.min_length, LENGTH)
    except BadInput as error:
        raise BadInput(f"--min-length {wanted.min_length!r} {error}") from None
    rates = dict(DEFAULT_RATES) if wanted.rates is None else parse_rates(wanted.rates)
    chosen: dict[str, Any] = {
        "representation": wanted.representation,
        "scoring": wanted.scoring,
        "surface": wanted.surface,
        "rates": rates,
        "crowding": wanted.crowding,
    }
    if wanted.preset is not None:
        chosen |= {name: value for name, value in PUBLISHED.items() if not _is_given(name)}
    for name in wanted.without:
        if name not in OPERATORS:
            raise BadInput(f"--without {name!r}: there is no such operator; use {', '.join(OPERATORS)}")
        chosen["rates"] = chosen["rates"] | {name: 0.0}
    if not any(chosen["rates"].values()):
        raise BadInput("--without: every operator is off; leave one on")
    if chosen["scoring"] == "published":
        for name in ("surface", "alignment"):
            if _is_given(name):
                raise click.UsageError(f"{_flag(name)}: the published scoring has its own; leave it out")
        chosen["surface"] = "bottom"
    return Choices(
        targets=str(wanted.targets),
        design=wanted.design_name,
        population=wanted.population,
        fibers_per_face=wanted.fibers_per_face,
        min_length_mm=min_length_mm,
        rig=None if wanted.rig_path is None else str(wanted.rig_path),
        alignment=wanted.alignment,  # type: ignore[arg-type]
        **chosen,
    )


def _seeds(wanted: _Wanted) -> list[int]:
    if wanted.seeds is None:
        return [wanted.seed]
    if _is_given("seed"):
        raise click.UsageError("give --seed or --seeds, not both")
    parts = [part.strip() for part in wanted.seeds.split(",")]
    if not all(part.isdecimal() for part in parts) or len(set(map(int, parts))) < len(parts):
        raise BadInput(f"--seeds {wanted.seeds!r}: write whole numbers from 0, each once, as in 1,2,3")
    return [int(part) for part in parts]


def _check_same(wanted: _Wanted, planned: "list[PlannedRun]") -> None:
    """Options repeated beside --resume must be the run's own."""
    from evolve.settings import differences
    from labctl.evolution.choices import settings_of

    given = [name for name in _CHOICES if _is_given(name)]
    if not given:
        return
    if wanted.targets is None:
        raise click.UsageError(
            f"--resume goes on with the settings of the run: leave {_flag(given[0])} out, or repeat the whole command"
        )
    seeds = [run.settings.seed for run in planned]
    if sorted(_seeds(wanted)) != sorted(seeds):
        raise BadInput(
            f"{wanted.out_path}: the run has the seeds {', '.join(map(str, seeds))}: leave them out"
        )
    asked = settings_of(_choices(wanted), planned[0].settings.seed, _compile)
    if differ := differences(asked, planned[0].settings):
        raise BadInput(
            f"{wanted.out_path}: holds a run with other settings, asked / there: {'; '.join(differ)}: leave them "
            "out, or begin another run in another folder"
        )


def _pool(planned: "list[PlannedRun]", wanted: _Wanted) -> "Pool":
    import os

    problem = planned[0].settings.problem
    if wanted.cluster is not None:
        from evolve.workers.cluster import Cluster

        return Cluster(problem, wanted.cluster)
    from evolve.workers.local import Here, Processes

    workers = wanted.workers or len(os.sched_getaffinity(0))
    return Here(problem) if workers == 1 else Processes(problem, workers)


def _search(
    planned: "list[PlannedRun]", pool: "Pool", stop: StopRequest, out_path: Path, as_json: bool
) -> None:
    from evolve.errors import SearchStopped
    from labctl.evolution.running import carry_on

    with Progress(quiet=as_json) as progress, pool:
        for run in planned:
            begun = progress.begin(run)
            try:
                for checkpoint in carry_on(run, pool, time.monotonic, lambda: stop.asked):
                    begun(checkpoint)
                    if stop.asked:
                        raise SearchStopped
            except SearchStopped as error:
                raise Stopped(
                    f"stopped; every finished generation is kept: labctl evolve --resume --out {out_path}"
                ) from error


def _compile(solver: str, precision: str) -> None:
    from sim.warm import compile_kernels

    compile_kernels(_say, solver, precision)  # type: ignore[arg-type]


def _say(text: str) -> None:
    click.echo(f"labctl: {text}", err=True)


def _is_given(option: str) -> bool:
    return click.get_current_context().get_parameter_source(option) is ParameterSource.COMMANDLINE


def _flag(name: str) -> str:
    for parameter in click.get_current_context().command.params:
        if parameter.name == name:
            return parameter.opts[0]
    return name
