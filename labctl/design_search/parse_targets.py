"""The targets of a search, named in a person's words."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evolve.problem import Physics
from labctl.config.design import Design
from labctl.errors import BadInput
from labctl.simulation.sheets import pattern_sheet
from labctl.simulation.targets.parse_target import parse_target
from sim.heights import Surface
from sim.kernel import Precision
from sim.shape import Failure
from sim.solver import SolverName
from sim.targets.target import Target

# Called with a solver and its precision before anything is simulated by them.
CompileFirst = Callable[[SolverName, Precision], None]
# The paper's, whose peaks are 20 mm (docs/reference/published-experiment.md).
_SHORT = {"saddle": "saddle:20mm", "monkey-saddle": "monkey-saddle:20mm"}
PATTERN = "pattern:"
_BRACKETS = {"(": 1, ")": -1}


def split_targets(text: str) -> tuple[str, ...]:
    """The targets of "cylinder,sphere": parted at commas that are in no brackets.

    Raises:
        BadInput: there is none, one is empty, or one is named twice.
    """
    parts, depth = [""], 0
    for letter in text:
        depth += _BRACKETS.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    words = tuple(part.strip() for part in parts)
    if not all(words):
        raise BadInput(f"--targets {text!r}: a target is missing; write them as in cylinder,sphere")
    for word in words:
        if words.count(word) > 1:
            raise BadInput(f"--targets {text!r}: {word!r} is there twice; name each shape once")
    return words


def full_target_name(word: str, design: Design) -> str:
    """A target as docs/reference/targets.md has it: a pattern's bare name is that pattern."""
    if word in design.patterns:
        return PATTERN + word
    if word in _SHORT:
        return _SHORT[word]
    if not re.search(r"[:=.]", word):
        known = ", ".join([*sorted(design.patterns), *_SHORT])
        raise BadInput(
            f"no target is called {word!r}: use {known}, or a shape, an equation or a file "
            "(docs/reference/targets.md)"
        )
    return word


def targets_of(
    words: Sequence[str], design: Design, physics: Physics, surface: Surface
) -> tuple[Target, ...]:
    """The targets, each under a short name of its own; patterns of the design are simulated by `physics`.

    Raises:
        BadInput: no target is called so, or it cannot be made for this sheet.
    """

    def pattern_heights_m(pattern: str) -> NDArray[np.float64]:
        shape = physics.solve(pattern_sheet(design, pattern))
        if isinstance(shape, Failure):
            raise BadInput(f"target pattern:{pattern} has no shape: {shape.describe()}")
        return shape.height_field_m(surface)

    targets: list[Target] = []
    for word in words:
        full = full_target_name(word, design)
        if full in (known.source for known in targets):
            raise BadInput(f"target {word!r}: {full} is there already; name each shape once")
        target = parse_target(full, design, physics.geometry, pattern_heights_m)
        name = _short_name(full, {known.name for known in targets})
        targets.append(replace(target, name=name, source=full))
    return tuple(targets)


def _one_line(text: str) -> str:
    """What a design takes as a pattern's name: a file may be called anything."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _short_name(words: str, taken: set[str]) -> str:
    """A name for a pattern of a design: of a file its column or stem, of a shape its kind, of an equation "z"."""
    if "=" in words.split(":")[0]:
        name = "z"
    elif match := re.search(r"([^/\\:]+)\.csv(?::(.+))?$", words, re.IGNORECASE):
        name = _one_line(match[2] or match[1]) or "shape"
    else:
        kind, _, argument = words.partition(":")
        name = argument if kind == "pattern" else kind
    numbered = (f"{name}-{n}" for n in range(2, 1000))
    return name if name not in taken else next(each for each in numbered if each not in taken)
