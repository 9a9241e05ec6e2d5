"""docs/results/interop.md: which clients were run, and how each operation went."""

from collections import Counter
from dataclasses import dataclass

from clients import Differences

RESULTS = ("works", "refused rightly", "refused", "wrong")


@dataclass(frozen=True)
class Row:
    """One operation of one client."""

    operation: str
    result: str
    detail: str


@dataclass(frozen=True)
class Ran:
    """One client on one double; `absent` says why it was not run."""

    client: str
    version: str
    target: str
    rows: tuple[Row, ...]
    absent: str | None = None
    differences: Differences | None = None

    def unexplained(self) -> list[Row]:
        """What went wrong, and what was refused without a known reason."""
        known = self.differences.operations if self.differences else frozenset()
        return [
            row
            for row in self.rows
            if row.result == "wrong" or (row.result == "refused" and row.operation not in known)
        ]


def page_of(runs: list[Ran], when: str, about: str) -> str:
    """The page as Markdown."""
    lines = [
        "# Clients written elsewhere, on the doubles",
        "",
        f"Made by `make interop` on {when} ({about}). Each client is installed as published, run against "
        "`labctl doubles serve`, and never part of this project. *Works*: the client returned what the double holds. "
        "*Refused rightly*: the device has not what was asked, and the client was told so. *Refused*, *wrong*: a "
        "difference between client and double, with its words below.",
        "",
        f"| Client | Double | {' | '.join(result.capitalize() for result in RESULTS)} |",
        f"|---|---|{'---|' * len(RESULTS)}",
    ]
    for ran in runs:
        counts = Counter(row.result for row in ran.rows)
        told = " | ".join(str(counts[result]) for result in RESULTS)
        cells = told if ran.absent is None else f"not run: {_cell(ran.absent)} |" + " |" * (len(RESULTS) - 2)
        lines.append(f"| {ran.client} {ran.version} | {ran.target} | {cells} |")
    for ran in runs:
        if ran.absent is None:
            lines += [
                "",
                f"## {ran.client} {ran.version}: {ran.target}",
                "",
                "| Operation | Result | Value or words |",
            ]
            lines.append("|---|---|---|")
            lines += [f"| {_cell(row.operation)} | {row.result} | {_cell(row.detail)} |" for row in ran.rows]
            lines += ["", ran.differences.why] if ran.differences else []
    return "\n".join([*lines, ""])


def _cell(text: str) -> str:
    printable = "".join(character if character.isprintable() else repr(character)[1:-1] for character in text)
    return printable.replace("|", "\\|").replace("<", "&lt;")
