"""The settings of a run: everything that its result depends on, as data that can be kept in a file."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from hashlib import sha256
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from evolve.afpo import Afpo
from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.problem import Physics, Problem
from evolve.selection import Crowding
from evolve.variation import Variation
from sim.geometry import geometry
from sim.heights import Surface
from sim.materials import Materials
from sim.score import Scoring
from sim.targets.target import Target


@dataclass(frozen=True)
class Settings:
    """A problem, the constraints, and how to search.

    `notes` is whatever the caller wants to find again beside a run (the sheet's design, versions); nothing here
    reads it.
    """

    problem: Problem
    constraints: Constraints
    seed: int
    population: int = 100
    crowding: Crowding = "contribution"
    variation: Variation = field(default_factory=Variation)
    notes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.problem.targets) != self.constraints.patterns:
            raise EvolveError(
                f"{len(self.problem.targets)} targets, but constraints for {self.constraints.patterns} patterns"
            )

    def engine(self) -> Afpo:
        """A search at its beginning.

        Raises:
            EvolveError: as `Afpo`.
        """
        return Afpo(self.population, self.constraints, self.variation, self.crowding, self.seed)

    @property
    def digest(self) -> str:
        """Names the settings: runs with equal ones are equal, bit for bit."""
        data = settings_to_json(self)
        del data["notes"]
        return sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def settings_to_json(settings: Settings) -> dict[str, Any]:
    """What JSON can hold; floats keep every bit."""
    problem, physics = settings.problem, settings.problem.physics
    return {
        "targets": [_target_to_json(target) for target in problem.targets],
        "physics": asdict(physics) | {"geometry": physics.geometry.name},
        "surface": problem.surface,
        "scoring": asdict(problem.scoring),
        "constraints": asdict(settings.constraints) | {"geometry": settings.constraints.geometry.name},
        "seed": settings.seed,
        "population": settings.population,
        "crowding": settings.crowding,
        "rates": dict(settings.variation.rates),
        "notes": dict(settings.notes),
    }


def settings_from_json(data: Mapping[str, Any]) -> Settings:
    """The settings that `settings_to_json` wrote.

    Raises:
        EvolveError: they are not such.
    """
    try:
        physics, constraints = dict(data["physics"]), dict(data["constraints"])
        physics["geometry"] = geometry(physics["geometry"])
        physics["materials"] = _typed(Materials, physics["materials"])
        constraints["geometry"] = geometry(constraints["geometry"])
        targets = tuple(_target_from_json(target) for target in data["targets"])
        return Settings(
            Problem(
                _typed(Physics, physics),
                targets,
                _typed(Surface, data["surface"]),
                _typed(Scoring, data["scoring"]),
            ),
            _typed(Constraints, constraints),
            _typed(int, data["seed"]),
            _typed(int, data["population"]),
            _typed(Crowding, data["crowding"]),
            Variation(_typed(dict[str, float], data["rates"])),
            _typed(dict[str, Any], data["notes"]),
        )
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise EvolveError(
            f"the settings are not those of a run: {where} {first['input']!r}: {first['msg']}"
        ) from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise EvolveError(f"the settings are not those of a run ({type(error).__name__}: {error})") from error


def differences(one: Settings, other: Settings) -> list[str]:
    """What differs, by name, but for the notes."""
    ours, theirs = settings_to_json(one), settings_to_json(other)
    found = []
    for name in ours:
        if name == "notes" or ours[name] == theirs[name]:
            continue
        if name == "targets":
            names = [", ".join(target["name"] for target in data[name]) for data in (ours, theirs)]
            found.append(f"targets ({names[0]} / {names[1]})")
        elif isinstance(ours[name], dict):
            keys = sorted(
                key for key in ours[name] | theirs[name] if ours[name].get(key) != theirs[name].get(key)
            )
            found += [f"{key} ({ours[name].get(key)} / {theirs[name].get(key)})" for key in keys]
        else:
            found.append(f"{name} ({ours[name]} / {theirs[name]})")
    return found


def _typed(kind: Any, value: Any) -> Any:  # noqa: ANN401 - whatever a file holds, as a type says
    # Pydantic passes over what a dataclass does not have.
    if is_dataclass(kind) and (unknown := set(value) - {entry.name for entry in fields(kind)}):
        raise TypeError(f"nothing is called {', '.join(sorted(unknown))}")
    return TypeAdapter(kind).validate_python(value)


def _target_to_json(target: Target) -> dict[str, Any]:
    rows = [[None if np.isnan(h) else h for h in row] for row in target.heights_m.tolist()]
    return {
        "name": target.name,
        "source": target.source,
        "geometry": target.geometry.name,
        "heights_m": rows,
    }


def _target_from_json(data: Mapping[str, Any]) -> Target:
    heights_m = np.array(
        [[np.nan if h is None else h for h in row] for row in data["heights_m"]], dtype=np.float64
    )
    return Target(data["name"], data["source"], geometry(data["geometry"]), heights_m)
