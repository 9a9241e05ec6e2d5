"""What markers do that they should not, 1 000 times at random: is a height ever wrong?

Each scenario is a trial whose true heights are known: the double's sheet (relaxing, creeping) on one of four rigs, of
four shapes and several heights, flat to full pressure, seen by the double's cameras with the double's faults
(tests/marker_scenarios.py), and what `derive` makes of it. Every height must be within 0.1 mm of the truth, or its
point not seen and named; no trial may be good with a wrong height. `--law 1` shows what plain means would have made
of the same recordings. `--seed` repeats them; exit code 1 where a height was wrong.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from marker_scenarios import Judged, Scenario, judge, random_scenario

COLUMNS = (
    ("trials good", "good"),
    ("trials that do not count", "not"),
    ("heights within 0.1 mm", "right"),
    ("heights not seen, named", "named"),
    ("heights not seen, NOT named", "UNNAMED"),
    ("heights WRONG", "WRONG"),
    ("wrong heights in good trials", "in good"),
    ("faultless points lost", "lost"),
)


@dataclass
class Tally:
    """What came of the scenarios of one kind, and the farthest height from the truth and from the undisturbed one."""

    scenarios: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    farthest_mm: float = 0.0
    from_undisturbed_mm: float = 0.0

    def take(self, judged: Judged) -> None:
        """One scenario more."""
        self.scenarios += 1
        self.counts += judged.counts
        self.farthest_mm = max(self.farthest_mm, judged.farthest_mm)
        self.from_undisturbed_mm = max(self.from_undisturbed_mm, judged.from_clean_mm)


def main() -> int:
    """Run the scenarios and print a line for each kind; 0 when no height was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", type=int, default=1000)
    parser.add_argument(
        "--seed", type=int, default=int(time.time()), help="draws the scenarios (default: the time)"
    )
    parser.add_argument("--law", type=int, choices=(1, 2), default=2, help="of measurement")
    parser.add_argument("--out", type=Path, help="the counts as JSON")
    options = parser.parse_args()
    print(f"{options.scenarios} scenarios, law {options.law}, seed {options.seed}", flush=True)
    rng = np.random.default_rng(options.seed)
    drawn = [random_scenario(rng) for _ in range(options.scenarios)]
    begun_s = time.monotonic()
    tallies: dict[str, Tally] = {}
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        judgements = pool.map(partial(judge, law=options.law), [each for _, each in drawn], chunksize=10)
        for done, ((kind, scenario), judged) in enumerate(zip(drawn, judgements, strict=True), start=1):
            tallies.setdefault(kind, Tally()).take(judged)
            _tell(kind, scenario, judged)
            if done % 100 == 0:
                print(f"{done} done after {time.monotonic() - begun_s:.0f} s", file=sys.stderr, flush=True)
    _print(tallies)
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(
            json.dumps({kind: dict(tally.counts) for kind, tally in tallies.items()}, indent=1)
        )
    bad = ("heights WRONG", "heights not seen, NOT named")
    return 1 if any(tally.counts[name] for tally in tallies.values() for name in bad) else 0


def _tell(kind: str, scenario: Scenario, judged: Judged) -> None:
    if judged.wrong:
        faults = " ".join(scenario.words)
        where = (
            f"{scenario.rig}, {scenario.shape} of {scenario.height_mm:g} mm at {scenario.pressure_psi:g} psi"
        )
        print(f"{kind}: {faults} on {where}, seed {scenario.seed}: {'; '.join(judged.wrong)}", flush=True)


def _print(tallies: dict[str, Tally]) -> None:
    whole = Tally()
    width = max(map(len, tallies))
    names = "".join(f"{short:>9}" for _, short in COLUMNS)
    print(f"\n{'':{width}}{'tries':>7}{names}  farthest mm  from undisturbed mm")
    for kind in sorted(tallies):
        _line(kind, tallies[kind], width)
        whole.scenarios += tallies[kind].scenarios
        whole.counts += tallies[kind].counts
        whole.farthest_mm = max(whole.farthest_mm, tallies[kind].farthest_mm)
        whole.from_undisturbed_mm = max(whole.from_undisturbed_mm, tallies[kind].from_undisturbed_mm)
    _line("all", whole, width)


def _line(kind: str, tally: Tally, width: int) -> None:
    counts = "".join(f"{tally.counts[name]:>9}" for name, _ in COLUMNS)
    print(
        f"{kind:{width}}{tally.scenarios:>7}{counts}{tally.farthest_mm:>13.3f}{tally.from_undisturbed_mm:>19.3f}"
    )


if __name__ == "__main__":
    sys.exit(main())
