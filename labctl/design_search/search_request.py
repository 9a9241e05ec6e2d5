"""A search as requested, and the settings that follow from it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from platform import python_version
from typing import Any, Literal

from evolve.constraints import Constraints, Representation
from evolve.problem import Problem
from evolve.selection import Crowding
from evolve.settings import Settings
from evolve.variation import DEFAULT_RATES, OPERATORS, PUBLISHED_RATES, Variation
from evolve.workers.same_program import differences, program
from labctl.config.design import Design
from labctl.config.load import design_text, load_design, load_rig
from labctl.config.schema_design import CHANNELS, SHORTEST_FIBER_MM
from labctl.design_search.parse_targets import CompileFirst, full_target_name, split_targets, targets_of
from labctl.design_search.published import PUBLISHED_SURFACE, published_physics, published_scoring
from labctl.errors import BadInput
from sim.geometry import geometry
from sim.heights import Surface
from sim.score import Alignment, Scoring

ScoringName = Literal["default", "published"]
_PROGRAM = "program"
_VERSIONS_OF = ("labctl", "numpy", "scipy", "numba", "moocore")


@dataclass(frozen=True)
class SearchRequest:
    """A search, complete, in the terms of the command line; `rates` None for the default ones."""

    targets: str
    design: str = "known"
    representation: Representation = "shared"
    population: int = 100
    fibers_per_face: int = 6
    min_length_mm: float = SHORTEST_FIBER_MM
    rig: str | None = None
    scoring: ScoringName = "default"
    surface: Surface = "top"
    alignment: Alignment = "none"
    rates: Mapping[str, float] | None = None
    crowding: Crowding = "contribution"


# What the paper's runs did, as far as it is known; generations are the command's.
PUBLISHED: Mapping[str, Any] = {
    "representation": "exclusive",
    "scoring": "published",
    "surface": "bottom",
    "rates": dict(PUBLISHED_RATES),
    "crowding": "twins",
}


def search_settings(request: SearchRequest, seed: int, compile_first: CompileFirst) -> Settings:
    """The settings of a run with that seed; targets that are patterns are simulated for it.

    `compile_first` is called with the solver and its precision before that.

    Raises:
        BadInput: a target, the design or the rig cannot be used, or the constraints contradict each other.
        EvolveError: likewise, from the evolution itself.
    """
    design = load_design(request.design)
    names = split_targets(request.targets)
    channels = _channels(request.rig)
    if request.min_length_mm < SHORTEST_FIBER_MM:
        raise BadInput(
            f"--min-length {request.min_length_mm:g} mm: the shortest fiber that can be fabricated is "
            f"{SHORTEST_FIBER_MM:g} mm; use that or more"
        )
    constraints = Constraints(
        geometry(design.sheet.geometry),
        len(names),
        request.representation,
        request.min_length_mm / 1e3,
        request.fibers_per_face,
        valves=len(channels),
    )
    notes = {
        "choices": asdict(request),
        "sheet": f"of design {design.name} ({design.source})",
        "design": {"source": design.source, "text": design_text(request.design)},
        "channels": channels,
        _PROGRAM: _program(),
        "versions": {"python": python_version()} | {name: version(name) for name in _VERSIONS_OF},
    }
    return Settings(
        _problem(request, design, compile_first),
        constraints,
        seed,
        request.population,
        request.crowding,
        Variation(DEFAULT_RATES if request.rates is None else dict(request.rates)),
        notes,
    )


def other_notes(one: Settings, other: Settings) -> list[str]:
    """What differs, as text, in what a picked design is written by: the sheet's design and the rig's valves."""
    noted = [settings.notes.get("design") for settings in (one, other)]
    # A note is whatever stands in a file.
    texts = [design.get("text") if isinstance(design, Mapping) else None for design in noted]
    found = ["the text of the design"] if texts[0] != texts[1] else []
    ours, theirs = (settings.notes.get("channels") for settings in (one, other))
    if ours != theirs:
        found.append(f"valve channels ({ours} / {theirs})")
    return found


def other_program(settings: Settings) -> str:
    """How the program that began a run differs from this one, as text; empty if it does not, or is not noted."""
    noted = settings.notes.get(_PROGRAM)
    return differences(_program(), noted) if isinstance(noted, Mapping) else ""


def _problem(request: SearchRequest, design: Design, compile_first: CompileFirst) -> Problem:
    names = split_targets(request.targets)
    if request.scoring == "published":
        physics = published_physics(design)
        surface, scoring = (
            PUBLISHED_SURFACE,
            published_scoring(full_target_name(name, design) for name in names),
        )
    else:
        held = design.sheet.rated_strain
        physics = replace(published_physics(design), solver="equilibrium", strain=held)
        surface, scoring = request.surface, Scoring(alignment=request.alignment)
    compile_first(physics.solver, physics.precision)
    return Problem(physics, targets_of(names, design, physics, surface), surface, scoring)


def parse_rates(text: str) -> dict[str, float]:
    """Rates from "near=0.5,count=0.2"; operators that are not named are off.

    Raises:
        BadInput: no such operator, or no number.
    """
    rates: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (piece.strip() for piece in part.partition("="))
        try:
            rate = float(value)
        except ValueError:
            rate = -1.0
        if name not in OPERATORS or not 0 <= rate < float("inf"):
            raise BadInput(
                f"--rates {text!r}: {part.strip()!r} is no operator with a rate from 0 up; write near=0.5,count=0.2 "
                f"with some of {', '.join(OPERATORS)}"
            )
        if name in rates:
            raise BadInput(f"--rates {text!r}: {name} is there twice; give each operator one rate")
        rates[name] = rate
    if not any(rates.values()):
        raise BadInput(f"--rates {text!r}: every operator is off; give one a rate above 0")
    if not isfinite(sum(rates.values())):
        raise BadInput(f"--rates {text!r}: the sum is too large a number; they are shares, 0.5 is as good")
    return rates


def _program() -> dict[str, str]:
    """What a search's result depends on beside its settings: that of the scores, and the library that ranks."""
    return {**program(), "moocore": version("moocore")}


def _channels(rig_path: str | None) -> list[int]:
    """The valve channels that fibers can have: all of the rig's but the dump valve's, or of the largest board."""
    if rig_path is None:
        return list(range(1, CHANNELS + 1))
    valves = load_rig(Path(rig_path)).valves
    return [channel for channel in range(1, valves.channels + 1) if channel != valves.dump_channel]
