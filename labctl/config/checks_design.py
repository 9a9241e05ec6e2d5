"""What the fibers and patterns of a design file mean together.

These look at the file as TOML has it, so that they speak up even where another key is wrong; a value that
the schema refuses already is passed over here.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from labctl.config.errors import Problem
from labctl.config.source import Document
from labctl.config.validate import problem_at, suggestion


def design_problems(document: Document) -> list[Problem]:
    """Every mistake that shows only when keys are seen together."""
    return [
        *_nothing_there(document),
        *_repeated_ids(document),
        *_shared_channels(document),
        *_bad_patterns(document),
    ]


def _nothing_there(document: Document) -> Iterator[Problem]:
    if document.table.get("fibers") == []:
        yield problem_at(document, ("fibers",), "has no fiber; a design needs at least one")
    if document.table.get("patterns") == {}:
        yield problem_at(document, ("patterns",), "has no pattern; a design needs at least one")


def _repeated_ids(document: Document) -> Iterator[Problem]:
    first: dict[str, int] = {}
    for index, fiber in _fibers(document):
        name = fiber.get("id")
        if not isinstance(name, str):
            continue
        if name in first:
            message = f"is the id of fiber #{first[name] + 1} too; give each fiber its own"
            yield problem_at(document, ("fibers", index, "id"), message)
        first.setdefault(name, index)


def _shared_channels(document: Document) -> Iterator[Problem]:
    first: dict[int, str] = {}
    for index, fiber in _fibers(document):
        channel = fiber.get("channel")
        if not isinstance(channel, int) or isinstance(channel, bool):
            continue
        name = str(fiber.get("id", f"#{index + 1}"))
        if channel in first:
            message = f"fibers {first[channel]} and {name} are on one channel; each needs a valve of its own"
            yield problem_at(document, ("fibers", index, "channel"), message)
        first.setdefault(channel, name)


def _bad_patterns(document: Document) -> Iterator[Problem]:
    known = {fiber["id"] for _, fiber in _fibers(document) if isinstance(fiber.get("id"), str)}
    patterns = document.table.get("patterns")
    for pattern, ids in patterns.items() if isinstance(patterns, Mapping) else ():
        if ids == []:
            yield problem_at(document, ("patterns", pattern), "stiffens no fiber; name at least one")
        names = ids if isinstance(ids, list) else []
        for index, name in enumerate(names):
            path = ("patterns", pattern, index)
            if isinstance(name, str) and name and name not in known:
                yield problem_at(document, path, f"no fiber has this id; {suggestion(name, known)}")
            elif name in names[:index]:
                yield problem_at(document, path, "is in the pattern already; name each fiber once")


def _fibers(document: Document) -> Iterator[tuple[int, Mapping[str, Any]]]:
    fibers = document.table.get("fibers")
    for index, fiber in enumerate(fibers if isinstance(fibers, list) else []):
        if isinstance(fiber, Mapping):
            yield index, fiber
