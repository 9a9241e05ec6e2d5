"""`labctl evolve`: search for fiber layouts that take several shapes."""

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.evolve.options import (
    SETTING_OPTIONS,
    SearchOptions,
    flag,
    is_given,
    parse_seeds,
    search_options,
    search_request,
)
from labctl.cli.evolve.progress import Progress
from labctl.cli.evolve.show import pick, print_runs, show, stopped_before_the_page
from labctl.cli.options import design_option, json_option
from labctl.errors import BadInput, Stopped
from labctl.interrupts import stop_on_signals
from labctl.next_command import next_command
from labctl.stop import StopRequest

if TYPE_CHECKING:
    from evolve.problem import Problem
    from evolve.settings import Settings
    from evolve.workers.pool import Pool
    from labctl.design_search.run_search import PlannedRun


@click.group(invoke_without_command=True)
@search_options
@design_option
@json_option
def evolve(as_json: bool, **values: Any) -> None:  # noqa: ANN401 - click's values, as SearchOptions types them
    """Search for fiber layouts that reach several shapes from one sheet.

    Each generation is kept in the run's folder; Ctrl-C, or a crash, loses the one in progress only.
    """
    subcommand = click.get_current_context().invoked_subcommand
    if subcommand is not None:
        if given := [name for name in (*values, "as_json") if is_given(name)]:
            raise click.UsageError(
                f"{flag(given[0])} stands before {subcommand}: write it behind, if it is one of its own"
            )
        return
    options = SearchOptions(**values)
    if options.out_path is None:
        raise click.UsageError("name the run's folder: --out runs/a")
    if options.cluster is not None and options.workers is not None:
        raise click.UsageError("--workers are of this machine, --cluster is another: give one of them")

    from labctl.design_search.errors import lab_errors
    from sim.warm import compile_kernels

    again = next_command("evolve", "--resume", "--out", options.out_path)
    then = f": make room, then {again}"
    with stop_on_signals(doing="stopping at the last finished generation") as stop, lab_errors(then):
        settings = _resumed_settings(options, options.out_path) if options.resume else _new_settings(options)
        physics = settings[0].problem.physics
        compile_kernels(_notify, physics.solver, physics.precision)
        # The workers first: a cluster that does not answer must leave no folder behind.
        with _pool(settings[0].problem, options) as pool:
            _search(_planned_runs(options, options.out_path, settings), pool, stop, options.out_path, as_json)
    if stop.requested:
        raise stopped_before_the_page(options.out_path)
    print_runs(options.out_path, as_json, published=False)


evolve.add_command(show)
evolve.add_command(pick)


def _new_settings(options: SearchOptions) -> "list[Settings]":
    """The settings of the runs to begin, one a seed."""
    from labctl.design_search.search_request import search_settings

    if options.targets is None:
        raise click.UsageError("name the shapes: --targets cylinder,sphere")
    seeds = parse_seeds(options)
    first = search_settings(search_request(options), seeds[0], _compile)
    return [replace(first, seed=seed) for seed in seeds]


def _resumed_settings(options: SearchOptions, out_path: Path) -> "list[Settings]":
    """The settings of the runs to resume."""
    from labctl.design_search.run_search import requested_seeds
    from labctl.design_search.search_request import other_program
    from labctl.design_search.search_run import check_equal_settings, run_folders

    folders = run_folders(out_path)
    if not folders:
        raise BadInput(f"{out_path}: holds no run to resume: begin one without --resume")
    found = [(folder.path, folder.load()[0]) for folder in folders]
    check_equal_settings(found)
    first = found[0][1]
    _check_same(options, first, requested_seeds(out_path, found))
    if differ := other_program(first):
        _notify(f"the run was begun by another program ({differ}): it may not find the same any more")
    return [settings for _, settings in found]


def _planned_runs(options: SearchOptions, out_path: Path, settings: "list[Settings]") -> "list[PlannedRun]":
    from labctl.design_search.run_search import begin_runs, resume_runs

    if options.resume:
        return resume_runs(out_path, options.generations if is_given("generations") else None)
    return begin_runs(out_path, settings, options.generations)


def _check_same(options: SearchOptions, first: "Settings", seeds: list[int]) -> None:
    """Options repeated beside --resume must be the run's own."""
    from evolve.settings import differences
    from labctl.design_search.search_request import other_notes, search_settings

    given = [name for name in SETTING_OPTIONS if is_given(name)]
    if not given:
        return
    if options.targets is None:
        raise click.UsageError(
            f"--resume uses the settings of the run: leave {flag(given[0])} out, or repeat the whole command"
        )
    if sorted(parse_seeds(options)) != seeds:
        raise BadInput(
            f"{options.out_path}: the run has the seeds {', '.join(map(str, seeds))}: leave them out"
        )
    requested = search_settings(search_request(options), first.seed, _compile)
    if differ := differences(requested, first) + other_notes(requested, first):
        raise BadInput(
            f"{options.out_path}: holds a run with other settings, requested / there: {'; '.join(differ)}: leave "
            "them out, or begin another run in another folder"
        )


def _pool(problem: "Problem", options: SearchOptions) -> "Pool":
    import os

    if options.cluster is not None:
        from evolve.workers.cluster import Cluster

        return Cluster(problem, options.cluster)
    from evolve.workers.local import Here, Processes

    workers = options.workers or len(os.sched_getaffinity(0))
    return Here(problem) if workers == 1 else Processes(problem, workers)


def _search(
    planned: "list[PlannedRun]", pool: "Pool", stop: StopRequest, out_path: Path, as_json: bool
) -> None:
    from evolve.errors import SearchStopped
    from labctl.design_search.run_search import continue_run

    with Progress(quiet=as_json) as progress:
        for run in planned:
            begun = progress.begin(run)
            try:
                for checkpoint in continue_run(run, pool, time.monotonic, lambda: stop.requested):
                    begun(checkpoint)
                    if stop.requested:
                        raise SearchStopped
            except SearchStopped as error:
                raise Stopped(
                    "stopped; every finished generation is kept: continue with "
                    f"{next_command('evolve', '--resume', '--out', out_path)}"
                ) from error


def _compile(solver: str, precision: str) -> None:
    from sim.warm import compile_kernels

    compile_kernels(_notify, solver, precision)  # type: ignore[arg-type]


def _notify(text: str) -> None:
    click.echo(f"labctl: {text}", err=True)
