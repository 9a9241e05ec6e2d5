"""What every benchmark prints: the machine that it ran on, and tables in Markdown."""

import os
import platform
import statistics
from collections.abc import Sequence
from pathlib import Path

import numba


def machine() -> str:
    """What this runs on."""
    name = next(
        (
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if "model name" in line
        ),
        platform.processor(),
    )
    cores = os.cpu_count()
    return f"{name}, {cores} cores, Python {platform.python_version()}, Numba {numba.__version__}"


def row(*cells: object) -> None:
    """One line of a table."""
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def heading(*cells: object) -> None:
    """The first two lines of a table."""
    row(*cells)
    row(*("---" for _ in cells))


def mean_sd(values: Sequence[float]) -> tuple[float, float | None]:
    """Mean and sample standard deviation; None as the deviation of a single value."""
    return statistics.mean(values), statistics.stdev(values) if len(values) > 1 else None


def plus_minus(mean_and_spread: tuple[float, float | None], digits: int) -> str:
    """A mean and its spread as text; the mean alone where one value has no spread."""
    mean, spread = mean_and_spread
    return f"{mean:.{digits}f}" + ("" if spread is None else f" +- {spread:.{digits}f}")
