"""A search as text and tables: what was searched for, what it took, what came out."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from evolve.choose import Rule
from evolve.settings import Settings
from labctl.design_search.fiber_list import ListedFiber
from labctl.design_search.pick import FrontMember, Pick
from labctl.design_search.search_run import SearchRun
from labctl.report.page import Table
from labctl.report.picture_style import shortened

# Over a column of numbers; the whole names stand above.
# Of what a run notes; the rest is for programs: the choices on the command line, the text of the design.
_SHOWN_NOTES = ("sheet", "versions")
_LONGEST_NAME = 24
RULE_WORDS: Mapping[Rule, str] = {
    "paper": "paper: furthest below the mean errors of random layouts",
    "knee": "knee: the best compromise between the ends of the front",
}


def searched_for(runs: Sequence[SearchRun]) -> list[tuple[str, str]]:
    """What was searched for and how, as (name, text)."""
    settings = runs[0].settings
    problem, constraints = settings.problem, settings.constraints
    rates = ", ".join(f"{name} {rate:g}" for name, rate in settings.variation.rates.items() if rate > 0)
    return [
        *(
            (
                f"target {n}",
                target.name if target.source in target.name else f"{target.name} ({target.source})",
            )
            for n, target in enumerate(problem.targets, start=1)
        ),
        ("representation", _representation(settings)),
        (
            "constraints",
            f"fibers of at least {1e3 * constraints.min_length_m:g} mm; at most {constraints.fibers_per_face} on a "
            f"face and {constraints.fibers_over_a_cell} over one cell of it; {_valves(constraints.valves)}",
        ),
        ("scoring", _scoring(settings)),
        ("physics", _physics(settings)),
        ("search", f"population {settings.population}, crowding by {settings.crowding}; {rates}"),
        ("seeds", ", ".join(str(run.settings.seed) for run in runs)),
        *((name, _format_note(settings.notes[name])) for name in _SHOWN_NOTES if name in settings.notes),
    ]


def glance(runs: Sequence[SearchRun]) -> list[tuple[str, str]]:
    """What the runs took together, as (what, how much)."""
    records = [run.checkpoint.records[-1] for run in runs]
    seconds = sum(record.seconds for record in records)
    simulated = sum(record.counts.simulated for record in records)
    sheets = sum(record.counts.sheets for record in records)
    return [
        ("generations", _generations(runs)),
        ("time", duration(seconds)),
        ("sheets scored", f"{sheets:,}".replace(",", "\u00a0")),
        ("of them simulated, the others being known", f"{simulated:,}".replace(",", "\u00a0")),
        ("simulated sheets per second", f"{simulated / seconds:.1f}" if seconds > 0 else "-"),
        ("sheets that failed", str(sum(record.counts.failed for record in records))),
    ]


def duration(seconds: float) -> str:
    """A time for people: 43 s, 12 min 5 s, 3 h 7 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole}\u00a0s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes}\u00a0min\u00a0{rest}\u00a0s"
    return f"{minutes // 60}\u00a0h\u00a0{minutes % 60}\u00a0min"


def picks_table(runs: Sequence[SearchRun], picks: Sequence[Pick]) -> Table:
    """The picked designs and their errors."""
    head = (
        "picked by",
        *(f"{name}, mm" for name in _short(runs)),
        "sum, mm",
        "fibers (top + bottom)",
        "seed",
        "id",
    )
    rows = tuple(
        (
            "; ".join(RULE_WORDS[rule] for rule in pick.rules),
            *_errors(pick.chosen),
            f"{sum(pick.chosen.errors_mm):.3f}",
            _fibers(pick.chosen),
            str(pick.chosen.run.settings.seed),
            str(pick.chosen.member.id),
        )
        for pick in picks
    )
    return Table(head, rows)


def runs_table(runs: Sequence[SearchRun]) -> Table:
    """What each seed took and reached."""
    head = (
        "seed",
        "generations",
        "time",
        "sheets",
        "simulated",
        "failed",
        "front",
        "hypervolume",
        *(f"best {name}, mm" for name in _short(runs)),
    )
    rows = []
    for run in runs:
        record = run.checkpoint.records[-1]
        rows.append(
            (
                str(run.settings.seed),
                _generations([run]),
                duration(record.seconds),
                str(record.counts.sheets),
                str(record.counts.simulated),
                str(record.counts.failed),
                str(record.front),
                f"{record.hypervolume:.4f}",
                *(f"{1e3 * best_m:.3f}" for best_m in record.best_m),
            )
        )
    return Table(head, tuple(rows))


def front_table(runs: Sequence[SearchRun], members: Sequence[FrontMember], picks: Sequence[Pick]) -> Table:
    """The fronts of all runs; picked rows are marked."""
    rules = {id(pick.chosen.member): " and ".join(pick.rules) for pick in picks}
    several = len(runs) > 1
    head = (
        "pick",
        *(f"{name}, mm" for name in _short(runs)),
        *(("seed", "on the joint front") if several else ()),
        "age, generations",
        "made by",
        "fibers (top + bottom)",
        "id",
    )
    rows = tuple(
        (
            rules.get(id(each.member), ""),
            *_errors(each),
            *((str(each.run.settings.seed), "yes" if each.best else "no") if several else ()),
            str(each.member.age),
            each.member.made_by,
            _fibers(each),
            str(each.member.id),
        )
        for each in members
    )
    return Table(head, rows, frozenset(n for n, row in enumerate(rows) if row[0]))


def fibers_table(fibers: Iterable[ListedFiber], names: Sequence[str]) -> Table:
    """The fibers of one design."""
    head = ("fiber", "valve channel", "face", "start x, y mm", "end x, y mm", "length mm", "jammed for")
    return Table(
        head,
        tuple(
            (
                str(fiber.number),
                str(fiber.channel),
                fiber.face,
                f"{fiber.start_mm[0]:g}, {fiber.start_mm[1]:g}",
                f"{fiber.end_mm[0]:g}, {fiber.end_mm[1]:g}",
                f"{fiber.length_mm:.1f}",
                "; ".join(names[pattern] for pattern in sorted(fiber.patterns)),
            )
            for fiber in fibers
        ),
    )


def _short(runs: Sequence[SearchRun]) -> list[str]:
    return [shortened(name, _LONGEST_NAME) for name in runs[0].targets]


def _errors(chosen: FrontMember) -> tuple[str, ...]:
    return tuple(f"{error_mm:.3f}" for error_mm in chosen.errors_mm)


def _fibers(chosen: FrontMember) -> str:
    top = sum(fiber.face == "top" for fiber in chosen.member.genome)
    return f"{len(chosen.member.genome)} ({top} + {len(chosen.member.genome) - top})"


def _generations(runs: Sequence[SearchRun]) -> str:
    # The first generation has the number 0.
    done = [run.checkpoint.state.generation + 1 for run in runs]
    planned = sorted({run.generations for run in runs})
    each = f"{done[0]}" if len(set(done)) == 1 else f"{min(done)} to {max(done)}"
    return f"{each} of {' or '.join(map(str, planned))}"


def _representation(settings: Settings) -> str:
    if settings.constraints.representation == "exclusive":
        return "exclusive: each fiber is jammed for one target"
    return "shared: each fiber is jammed for any of the targets"


def _valves(valves: int | None) -> str:
    return "no limit of valves" if valves is None else f"{valves} valves, one a fiber"


def _scoring(settings: Settings) -> str:
    scoring, surface = settings.problem.scoring, settings.problem.surface
    columns = "all columns" if scoring.columns == "all" else "every 20th column"
    rounding = "unrounded" if scoring.rounding == "none" else "in whole mm"
    shift = (
        "heights as they stand" if scoring.alignment == "none" else "after the shift that makes e_s smallest"
    )
    return (
        f"e_s, the mean difference of heights, over {columns} of the {surface} surface, {rounding}, {shift}"
    )


def _physics(settings: Settings) -> str:
    physics = settings.problem.physics
    materials = physics.materials
    held = (
        f"at rest at strain {physics.strain:.4f}, registered rigidly"
        if physics.solver == "equilibrium"
        else "by the published protocol, raw heights"
    )
    bending = (
        ""
        if materials.jammed_bending_pa is None
        else f" ({materials.jammed_bending_pa / 1e3:g} kPa in bending)"
    )
    return (
        f"{physics.geometry.name} sheet, {held}; fibers as {physics.fibers_as}, "
        f"jammed {materials.jammed_pa / 1e3:g} kPa{bending}, "
        f"unjammed {materials.unjammed_pa / 1e3:g} kPa; {physics.precision}"
    )


def _format_note(value: Any) -> str:  # noqa: ANN401 - notes are whatever JSON holds
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_format_note(part)}" for name, part in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_format_note, value))
    return str(value)
