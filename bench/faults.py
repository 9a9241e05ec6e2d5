"""Links that break, over-pressure, and replies that are spoilt, by the thousand, on doubles.

- unplugged: each link breaks in the middle of a hold and comes back, in virtual time (`--cycles` a link);
- for real: the same on this machine's pseudo-terminals, sockets and guard process (`--real-cycles` a link);
- over-pressure: at a random moment of any state (`--injections` in all);
- frames: real drivers and links against spoilt replies (`--frames` spoilt ones a driver).

Prints tables in Markdown; exit code 1 where anything was wrong. `--seed` repeats everything but the real cycles.
"""

import argparse
import json
import logging
import random
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from bench_report import heading, machine, row
from fault_trials.fuzz_drivers import SUBJECTS, fuzz
from fault_trials.over_pressure import STATES, TICKS_S, over_pressure
from fault_trials.tallies import merged, times
from fault_trials.unplugged import BACK_S, LINKS, Breaks
from fault_trials.unplugged_for_real import RealBreaks
from phasespace_fuzz import fuzz_driver

PARTS = ("unplugged", "for-real", "over-pressure", "frames")
MARKERS = "phasespace"
_CYCLES_A_JOB, _INJECTIONS_A_JOB, _FRAMES_A_JOB = 100, 300, 100_000
# Rigs of this machine share the names of its terminals: one rig at a time.
_REAL_PROCESSES = 1


def main() -> int:
    """Run the parts asked for; 0 when nothing was wrong."""
    options = _arguments()
    seed = random.SystemRandom().randrange(2**32) if options.seed is None else options.seed
    print(f"Machine: {machine()}. Seed {seed}.\n", flush=True)
    wrong: dict[str, list[str]] = {}
    found: dict[str, Any] = {"machine": machine(), "seed": seed}
    parts: dict[str, Callable[[argparse.Namespace, int], dict[str, Any]]] = {
        "unplugged": _unplugged,
        "for-real": _for_real,
        "over-pressure": _over_pressure,
        "frames": _frames,
    }
    for part in options.only or PARTS:
        started_s = time.monotonic()
        print(f"\n### {part}\n", flush=True)
        tallies = parts[part](options, seed)
        took_s = time.monotonic() - started_s
        print(f"\nIn {took_s / 60:.1f} minutes.", flush=True)
        found[part] = {"took_s": took_s} | {name: _as_json(tally) for name, tally in tallies.items()}
        wrong |= {f"{part}, {name}": tally.wrong for name, tally in tallies.items() if tally.wrong}
    for name, what in wrong.items():
        print(f"\nWRONG: {name}: {len(what)} times, such as:", *what[:3], sep="\n  ")
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(found, indent=1) + "\n")
    return 1 if wrong else 0


def _unplugged(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    """Virtual time."""
    jobs = [
        (link, _seed(seed, link, number), cycles)
        for link in LINKS
        for number, cycles in enumerate(_shared(options.cycles, _CYCLES_A_JOB))
    ]
    return _breaks_table(_run(options.processes, _breaks, jobs), jobs)


def _for_real(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    """This machine's time."""
    jobs = [(link, _seed(seed, link, 0), options.real_cycles) for link in LINKS]
    return _breaks_table(_run(_REAL_PROCESSES, _real_breaks, jobs), jobs)


def _breaks_table(results: list[Any], jobs: list[tuple[str, int, int]]) -> dict[str, Any]:
    tallies = _by_name(results, [name for name, *_ in jobs])
    heading(
        "link",
        "cycles",
        "how the run ended",
        "vented after the break, s",
        "run ended after the break, s",
        f"usable after the return, s ({BACK_S:g} allowed)",
        "SAFE before anybody opened it",
        "wrong",
    )
    for link, tally in tallies.items():
        endings = "; ".join(f"{count} {how}" for how, count in sorted(tally.endings.items()))
        row(
            link,
            tally.cycles,
            endings,
            times(tally.vented_s),
            times(tally.ended_s),
            times(tally.back_s),
            tally.safe_by_guard,
            len(tally.wrong),
        )
    return tallies


def _over_pressure(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    jobs = [
        (_seed(seed, "over-pressure", number), injections)
        for number, injections in enumerate(_shared(options.injections, _INJECTIONS_A_JOB))
    ]
    results = _run(options.processes, over_pressure, jobs)
    tallies = {state: merged([one[place] for one in results]) for place, state in enumerate(STATES)}
    heading(
        "injected",
        "times",
        "vented before a reading reached the limit",
        f"vented after the first reading at the limit, s ({TICKS_S:g} allowed)",
        "vented after the true pressure passed the limit, s",
        "highest true pressure, psi",
        "wrong",
    )
    for state, tally in tallies.items():
        row(
            state,
            tally.injections,
            tally.earlier,
            times(tally.after_reading_s),
            times(tally.blind_s),
            f"{tally.highest_psi:.1f}",
            len(tally.wrong),
        )
    row("all", sum(tally.injections for tally in tallies.values()), "", "", "", "", "")
    return tallies


def _frames(options: argparse.Namespace, seed: int) -> dict[str, Any]:
    names = [*SUBJECTS, MARKERS]
    jobs = [
        (name, _seed(seed, name, number), frames)
        for name in names
        for number, frames in enumerate(_shared(options.frames, _FRAMES_A_JOB))
    ]
    tallies = _by_name(_run(options.processes, _fuzz, jobs), [name for name, *_ in jobs])
    heading(
        "driver",
        "spoilt frames",
        "calls",
        "right",
        "errors by name",
        "undetectable in principle",
        "false",
        "crashes",
        "longest call, s",
    )
    for name, tally in tallies.items():
        errors = ", ".join(f"{count} {kind}" for kind, count in sorted(tally.errors.items()))
        row(
            name,
            tally.frames,
            tally.calls,
            tally.right,
            errors,
            tally.undetectable,
            len(tally.false_readings),
            len(tally.crashes),
            f"{tally.longest_s:.3f}",
        )
    return tallies


def _breaks(link: str, seed: int, cycles: int) -> Any:  # noqa: ANN401 - a tally of tests/
    return Breaks(link, seed).run(cycles)


def _real_breaks(link: str, seed: int, cycles: int) -> Any:  # noqa: ANN401
    return RealBreaks(link, seed).run(cycles)


def _fuzz(name: str, seed: int, frames: int) -> Any:  # noqa: ANN401
    return fuzz_markers(seed, frames) if name == MARKERS else fuzz(name, seed, frames)


def fuzz_markers(seed: int, frames: int) -> Any:  # noqa: ANN401
    """As `fuzz`, of the marker stream: a frame that was sent, or an error."""
    from fault_trials.fuzz_drivers import Tally

    tally = Tally(MARKERS)
    rng = np.random.default_rng(seed)
    while tally.frames < frames:
        try:
            sent, spoilt, read, refused = fuzz_driver(rng, 10_000, share=0.5)
        except AssertionError as error:
            tally.false_readings.append(str(error)[:500])
            continue
        except Exception as error:
            tally.crashes.append(repr(error))
            continue
        tally.frames += spoilt
        tally.calls += sent
        tally.right += read
        tally.errors["LabError"] = tally.errors.get("LabError", 0) + refused
    return tally


def _run(processes: int, do: Callable[..., Any], jobs: list[Any]) -> list[Any]:
    """The results in the order of the jobs; how far it is goes to standard error."""
    with ProcessPoolExecutor(processes, initializer=_quiet) as pool:
        running: list[Future[Any]] = [pool.submit(do, *job) for job in jobs]
        results = []
        for number, future in enumerate(running, start=1):
            results.append(future.result())
            print(f"  {number} of {len(jobs)}", end="\r", file=sys.stderr, flush=True)
        return results


def _quiet() -> None:
    # pymodbus reports each spoilt frame, and a report takes as long as the frame.
    logging.disable(logging.CRITICAL)


def _shared(total: int, largest: int) -> Iterator[int]:
    while total > 0:
        yield min(total, largest)
        total -= largest


def _seed(seed: int, name: str, number: int) -> int:
    return random.Random(f"{seed} {name} {number}").randrange(2**32)  # noqa: S311 - moments, not secrets


def _by_name(results: list[Any], names: list[str]) -> dict[str, Any]:
    pairs = list(zip(names, results, strict=True))
    return {name: merged([one for other, one in pairs if other == name]) for name in dict.fromkeys(names)}


def _as_json(tally: Any) -> dict[str, Any]:  # noqa: ANN401
    """Its numbers, long lists of times as median, 99th percentile and longest."""
    return {
        name: times(value) if name.endswith("_s") and isinstance(value, list) else value
        for name, value in asdict(tally).items()
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cycles", type=int, default=1000, help="of each link, in virtual time")
    parser.add_argument("--real-cycles", type=int, default=8, help="of each link, in this machine's time")
    parser.add_argument("--injections", type=int, default=10_000, help="of over-pressure, in all")
    parser.add_argument("--frames", type=int, default=1_000_000, help="spoilt ones, of each driver")
    parser.add_argument(
        "--only", action="append", choices=PARTS, help="this part; may be given more than once"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, help="drawn and printed without it")
    parser.add_argument("--out", type=Path, help="a JSON file for everything that was counted")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
