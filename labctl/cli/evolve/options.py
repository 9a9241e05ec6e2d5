"""The options of `labctl evolve`, and the request that follows from them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from labctl.cli.non_empty_path import NonEmptyPath
from labctl.errors import BadInput

if TYPE_CHECKING:
    from labctl.design_search.search_request import SearchRequest

GENERATIONS = 300
# A seed is part of a folder's name.
_SEED_DIGITS = 18
# The options that decide a search's result; all others are of where it runs and what is shown.
SETTING_OPTIONS = (
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
class SearchOptions:
    """The options as given on the command line."""

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


_OPTIONS = (
    click.option(
        "--targets", help="Target shapes: cylinder,sphere or saddle,monkey-saddle, or as simulate --target."
    ),
    click.option("--out", "out_path", type=NonEmptyPath(), help="Folder of the run, new or empty."),
    click.option(
        "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of all random numbers."
    ),
    click.option("--seeds", help="Seeds of several independent runs, one after the other: 1,2,3."),
    click.option(
        "--generations",
        type=click.IntRange(min=1),
        default=GENERATIONS,
        show_default=True,
        help="Number of generations, those already done included.",
    ),
    click.option(
        "--population",
        type=click.IntRange(2, 10_000),
        default=100,
        show_default=True,
        help="Number of layouts in each generation.",
    ),
    click.option(
        "--representation",
        type=click.Choice(["shared", "exclusive"]),
        default="shared",
        show_default=True,
        help="Let a fiber serve several shapes (shared), or one only, as published (exclusive).",
    ),
    click.option(
        "--fibers-per-face",
        type=click.IntRange(min=1),
        default=6,
        show_default=True,
        help="Most fibers on a face, those of all shapes together.",
    ),
    click.option(
        "--min-length", default="60 mm", show_default=True, help="Length of the shortest fiber allowed."
    ),
    click.option(
        "--rig",
        "rig_path",
        type=click.Path(path_type=Path),
        help="rig.toml whose valve channels the fibers get.  [default: a board of 32]",
    ),
    click.option(
        "--scoring",
        type=click.Choice(["default", "published"]),
        default="default",
        show_default=True,
        help="Score e_s at rest over all columns, or as published: whole mm, bottom layer, published protocol.",
    ),
    click.option(
        "--surface",
        type=click.Choice(["top", "bottom", "mid"]),
        default="top",
        show_default=True,
        help="Surface of the sheet that is scored.",
    ),
    click.option(
        "--alignment",
        type=click.Choice(["none", "offset"]),
        default="none",
        show_default=True,
        help="Score heights as they stand, or shifted by the median difference.",
    ),
    click.option("--rates", help="Rates of the operators, as shares: near=0.5,count=0.2; others are off."),
    click.option("--without", multiple=True, help="Operator to switch off; may be repeated."),
    click.option(
        "--crowding",
        type=click.Choice(["contribution", "twins"]),
        default="contribution",
        show_default=True,
        help="Which layouts go when the front alone is too many: of least hypervolume, or near-twins, as published.",
    ),
    click.option(
        "--preset",
        type=click.Choice(["published"]),
        help="Search as the paper did: exclusive, its operators, crowding and scoring.",
    ),
    click.option(
        "--workers",
        type=click.IntRange(min=1),
        help="Number of worker processes.  [default: one for each core]",
    ),
    click.option("--cluster", help="Address of a Dask cluster's scheduler to simulate on, tcp://HOST:8786."),
    click.option("--resume", is_flag=True, help="Continue the run in --out; --generations may be more."),
)


def search_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """All options of a search; --design and --json apart."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def search_request(options: SearchOptions) -> "SearchRequest":
    """The complete request; a preset gives way to what is named beside it.

    Raises:
        BadInput: a length, a rate or an operator that is none.
        click.UsageError: options that do not go together.
    """
    from evolve.variation import DEFAULT_RATES, OPERATORS
    from labctl.config.quantity import LENGTH, to_unit
    from labctl.design_search.search_request import PUBLISHED, SearchRequest, parse_rates

    try:
        min_length_mm = to_unit(options.min_length, LENGTH)
    except BadInput as error:
        raise BadInput(f"--min-length {options.min_length!r} {error}") from None
    rates = dict(DEFAULT_RATES) if options.rates is None else parse_rates(options.rates)
    chosen: dict[str, Any] = {
        "representation": options.representation,
        "scoring": options.scoring,
        "surface": options.surface,
        "rates": rates,
        "crowding": options.crowding,
    }
    if options.preset is not None:
        chosen |= {name: value for name, value in PUBLISHED.items() if not is_given(name)}
    for name in options.without:
        if name not in OPERATORS:
            raise BadInput(f"--without {name!r}: there is no such operator; use {', '.join(OPERATORS)}")
        chosen["rates"] = chosen["rates"] | {name: 0.0}
    if not any(chosen["rates"].values()):
        raise BadInput("--without: every operator is off; leave one on")
    if chosen["scoring"] == "published":
        for name in ("surface", "alignment"):
            if is_given(name):
                raise click.UsageError(f"{flag(name)}: the published scoring has its own; leave it out")
        chosen["surface"] = "bottom"
    return SearchRequest(
        targets=str(options.targets),
        design=options.design_name,
        population=options.population,
        fibers_per_face=options.fibers_per_face,
        min_length_mm=min_length_mm,
        rig=None if options.rig_path is None else str(options.rig_path),
        alignment=options.alignment,  # type: ignore[arg-type]
        **chosen,
    )


def parse_seeds(options: SearchOptions) -> list[int]:
    """The seeds of the runs, one or several.

    Raises:
        BadInput: --seeds is no list of them.
        click.UsageError: --seed is given too.
    """
    if options.seeds is None:
        return [options.seed]
    if is_given("seed"):
        raise click.UsageError("give --seed or --seeds, not both")
    parts = [part.strip() for part in options.seeds.split(",")]
    numbers = all(part.isascii() and part.isdecimal() and len(part) <= _SEED_DIGITS for part in parts)
    if not numbers or len(set(map(int, parts))) < len(parts):
        raise BadInput(
            f"--seeds {options.seeds!r}: write whole numbers from 0, of at most {_SEED_DIGITS} digits, each once, as "
            "in 1,2,3"
        )
    return [int(part) for part in parts]


def is_given(option: str) -> bool:
    """Whether an option of the running command stands on the command line."""
    return click.get_current_context().get_parameter_source(option) is ParameterSource.COMMANDLINE


def flag(name: str) -> str:
    """An option of the running command as it is written."""
    for parameter in click.get_current_context().command.params:
        if parameter.name == name:
            return parameter.opts[0]
    return name
