"""`labctl evolve show` and `labctl evolve pick`: the results of a run, and a design of it to build."""

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.non_empty_path import NonEmptyPath
from labctl.cli.options import json_option
from labctl.cli.output import emit_json, table
from labctl.errors import BadInput, LabError, Stopped
from labctl.interrupts import stop_on_signals
from labctl.next_command import next_command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from evolve.choose import Rule
    from evolve.selection import Member
    from evolve.settings import Settings
    from labctl.design_search.search_run import SearchRun

_PAGE = "index.html"
_RULES: "tuple[Rule, ...]" = ("paper", "knee")
# A table on a terminal; the page and --json have all of a front.
_ROWS = 20


@click.command()
@click.argument("run", type=NonEmptyPath())
@click.option(
    "--published",
    is_flag=True,
    help="Score the members in the table also as published; half a second a sheet.",
)
@json_option
def show(run: Path, published: bool, as_json: bool) -> None:
    """Show the results of a run, or of the runs of its seeds, and write their page, index.html."""
    from labctl.design_search.errors import lab_errors

    with lab_errors():
        print_runs(run, as_json, published=published)


@click.command()
@click.argument("run", type=NonEmptyPath())
@click.option(
    "--out", "out_path", type=NonEmptyPath(), help="Design file to write.  [default: RUN/RULE.toml]"
)
@click.option(
    "--rule",
    type=click.Choice(_RULES),
    default="paper",
    show_default=True,
    help="Rule to pick by: smallest sum of errors less random layouts' mean (paper), or the knee of the front.",
)
@click.option("--member", type=click.IntRange(min=0), help="Id of the member of the front to pick instead.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Seed of the run to pick from, if there are several.  [default: all together]",
)
@json_option
def pick(
    run: Path,
    out_path: Path | None,
    rule: "Rule",
    member: int | None,
    seed: int | None,
    as_json: bool,
) -> None:
    """Write a layout of a run's front as a design file, for labctl inflate --design."""
    from labctl.design_search.errors import lab_errors
    from labctl.design_search.picked_design import format_errors, write_picked
    from labctl.design_search.search_run import load_runs

    with lab_errors():
        runs = load_runs(run)
        if seed is not None:
            known = [str(each.settings.seed) for each in runs]
            runs = [each for each in runs if each.settings.seed == seed]
            if not runs:
                raise BadInput(f"{run}: has no run of seed {seed}, only of {', '.join(known)}")
        if member is not None and len(runs) > 1:
            raise BadInput(f"{run}: has several runs: name by --seed the run whose member {member} is meant")
        of_run, chosen = _chosen(runs, rule, member)
    basis = "the smallest sum of errors" if rule == "paper" else "the knee of the front"
    basis = f"member {member}" if member is not None else basis
    errors = format_errors(chosen, of_run)
    path = out_path or run / f"{rule if member is None else f'member-{member}'}.toml"
    write_picked(path, chosen, of_run, basis)
    if as_json:
        emit_json({"design": str(path), "seed": of_run.settings.seed, **_member(of_run.settings, chosen)})
        return
    click.echo(f"{basis} of seed {of_run.settings.seed}, member {chosen.id}: {errors}")
    pattern = of_run.settings.problem.targets[0].name
    click.echo(f"written: {path}; next: {next_command('inflate', '--design', path, '--pattern', pattern)}")


def print_runs(path: Path, as_json: bool, *, published: bool) -> None:
    """Print the results of the runs of a folder, and write their page."""
    try:
        _print_runs(path, as_json, published=published)
    except KeyboardInterrupt:
        raise Stopped(
            f"stopped; the run is kept as it was: {next_command('evolve', 'show', path)} draws its page"
        ) from None


def stopped_before_the_page(path: Path) -> Stopped:
    """What a stop after the search comes to."""
    return Stopped(
        f"stopped; the run is kept as it is: {next_command('evolve', 'show', path)} draws its page"
    )


def _print_runs(path: Path, as_json: bool, *, published: bool) -> None:
    from labctl.design_search.pick import all_picks
    from labctl.design_search.search_run import load_runs
    from labctl.report.search.page import write_evolution_page

    runs = load_runs(path)
    rescored = _rescored(runs) if published else [None] * len(runs)
    page = path / _PAGE
    picks = all_picks(runs)
    try:
        write_evolution_page(page, runs, picks)
    except BadInput as error:
        # The results need no page.
        if not as_json:
            _print_tables(runs, rescored)
        raise LabError(
            f"{error}; the run is kept: mend that, then {next_command('evolve', 'show', path)}"
        ) from error
    if as_json:
        results = [_run_to_json(run, each) for run, each in zip(runs, rescored, strict=True)]
        emit_json({"runs": results, "page": str(page)})
        return
    _print_tables(runs, rescored)
    click.echo(f"page: {page}")


def _print_tables(runs: "list[SearchRun]", rescored: "Sequence[tuple[Member, ...] | None]") -> None:
    for run, each in zip(runs, rescored, strict=True):
        _print_table(run, each)


def _print_table(run: "SearchRun", rescored: "tuple[Member, ...] | None") -> None:
    settings, checkpoint = run.settings, run.checkpoint
    now = checkpoint.records[-1]
    names = [target.name for target in settings.problem.targets]
    click.echo(
        f"{run.folder}: {', '.join(names)}, {settings.constraints.representation}, seed {settings.seed}, "
        f"{checkpoint.state.generation + 1} of {run.generations} generations of {settings.population}"
    )
    click.echo(
        f"{now.seconds / 60:.1f} min, {now.counts.simulated} sheets simulated of {now.counts.sheets} asked for, "
        f"{now.counts.simulated / now.seconds:.1f} a second, {now.counts.failed} without a shape; all but simulating "
        f"{100 * (1 - now.counts.simulating_s / now.seconds):.1f} % of the time; hypervolume {now.hypervolume:.4f}"
    )
    picks = _picks(run)
    published = {} if rescored is None else {member.id: member for member in rescored}
    head = ["member", *(f"{name} mm" for name in names)]
    head += [f"{name} mm as published" for name in names] if published else []
    shown = _shown(run)
    rows = []
    for member in shown:
        row = [str(member.id), *_millimetres(member)]
        if published:
            row += _millimetres(published[member.id]) if member.id in published else ["-"] * len(names)
        rows.append([*row, str(len(member.genome)), str(member.age), picks.get(member.id, "")])
    table([*head, "fibers", "age", "pick"], rows)
    if len(shown) < len(checkpoint.front.members):
        click.echo(
            f"{len(shown)} of the front's {len(checkpoint.front.members)} members; all: --json, or the page"
        )
    click.echo("")


def _shown(run: "SearchRun") -> "list[Member]":
    """The picks, and others evenly along the front, so many as a terminal can take."""
    members, picks = run.checkpoint.front.members, _picks(run)
    step = max(1, -(-len(members) // _ROWS))
    return [each for n, each in enumerate(members) if n % step == 0 or each.id in picks]


def _picks(run: "SearchRun") -> dict[int, str]:
    """The ids of the members that the rules pick, and the rules."""
    from labctl.design_search.pick import all_picks

    return {pick.chosen.member.id: " and ".join(pick.rules) for pick in all_picks([run])}


def _run_to_json(run: "SearchRun", rescored: "tuple[Member, ...] | None") -> dict[str, Any]:
    from labctl.design_search.pick import picked_member

    now = run.checkpoint.records[-1]
    result: dict[str, Any] = {
        "folder": str(run.folder),
        "seed": run.settings.seed,
        "targets": [target.name for target in run.settings.problem.targets],
        "representation": run.settings.constraints.representation,
        "generations": run.checkpoint.state.generation + 1,
        "generations_wanted": run.generations,
        "population": run.settings.population,
        "seconds": now.seconds,
        "sheets": now.counts.sheets,
        "simulated": now.counts.simulated,
        "failed": now.counts.failed,
        "sheets_per_second": now.counts.simulated / now.seconds,
        "hypervolume": now.hypervolume,
        "front": [_member(run.settings, member) for member in run.checkpoint.front.members],
        "picks": {rule: _member(run.settings, picked_member([run], rule).member) for rule in _RULES},
    }
    if rescored is not None:
        result["published"] = [_member(run.settings, member) for member in rescored]
    return result


def _member(settings: "Settings", member: "Member") -> dict[str, Any]:
    names = [target.name for target in settings.problem.targets]
    errors_mm = {name: 1e3 * error for name, error in zip(names, member.errors_m or (), strict=True)}
    return {"member": member.id, "age": member.age, "fibers": len(member.genome), "errors_mm": errors_mm}


def _millimetres(member: "Member") -> list[str]:
    return [f"{1e3 * error_m:.2f}" for error_m in member.errors_m or ()]


def _chosen(runs: "list[SearchRun]", rule: "Rule", member_id: int | None) -> "tuple[SearchRun, Member]":
    """A member by its id, or by the rule from the fronts of all runs together."""
    if member_id is None:
        from labctl.design_search.pick import picked_member

        picked = picked_member(runs, rule)
        return picked.run, picked.member
    (run,) = runs
    for member in run.checkpoint.front.members:
        if member.id == member_id:
            return run, member
    known = ", ".join(str(member.id) for member in run.checkpoint.front.members[:8])
    raise BadInput(
        f"{run.folder}: member {member_id} is not on the front; use one of {known} ... "
        f"({next_command('evolve', 'show', run.folder)})"
    )


def _rescored(runs: "list[SearchRun]") -> "list[tuple[Member, ...] | None]":
    from evolve.errors import SearchStopped
    from evolve.workers.local import Processes
    from labctl.design_search.published import published_problem, rescored
    from sim.warm import compile_kernels

    def compile_first(solver: Any, precision: Any) -> None:  # noqa: ANN401 - the solver's own names
        compile_kernels(lambda text: click.echo(f"labctl: {text}", err=True), solver, precision)

    problem = published_problem(runs[0], compile_first)
    try:
        with (
            stop_on_signals(doing="stopping") as stop,
            Processes(problem, len(os.sched_getaffinity(0))) as pool,
        ):
            return [
                rescored(_shown(run), problem, pool, time.monotonic, lambda: stop.requested) for run in runs
            ]
    except SearchStopped as error:
        raise Stopped("stopped; nothing was changed") from error
