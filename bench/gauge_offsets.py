"""How far the truth goes where the gauge's zero is off, from -1 to +1 psi (make bench-gauge).

For each offset one `inflate` to 3.9 psi and one to the rig's highest pressure, on doubles in virtual time: refused
before anything was energised, or measured; and the highest pressure by the double's own truth.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from bench_report import heading, row
from virtual_labctl import VirtualLabctl

STEPS = 20
STEP_PSI = 0.05
BOUND_PSI = 4.1


@dataclass(frozen=True)
class Tried:
    """How one inflation ended, and the highest true pressure in it."""

    offset_psi: float
    pressure_psi: float
    code: int
    highest_psi: float
    words: str

    @property
    def held(self) -> bool:
        """The bound was kept, or the rig was refused before it was pressurised."""
        return self.highest_psi <= BOUND_PSI


def offsets_psi() -> Iterator[float]:
    """From -1 to +1 psi in steps of 0.05."""
    yield from (round(number * STEP_PSI, 2) for number in range(-STEPS, STEPS + 1))


def inflate(offset_psi: float, pressure_psi: float, seed: int) -> Tried:
    """One inflation by a gauge that reads `offset_psi` too much."""
    with tempfile.TemporaryDirectory() as folder:
        lab = VirtualLabctl(Path(folder), f"regulator=offset:{offset_psi}", seed=seed)
        try:
            done = lab(
                *("inflate", "--pattern", "sphere", "--rig", lab.rig, "--pressure", f"{pressure_psi} psi")
            )
            return Tried(offset_psi, pressure_psi, done.code, lab.plant.highest_psi, _words(done.err))
        finally:
            lab.close()


def _words(err: str) -> str:
    told = [line.removeprefix("labctl: ") for line in err.splitlines() if line.startswith("labctl: ")]
    return next((line for line in told if "SIMULATED" not in line and "taking it to SAFE" not in line), "")


def main() -> int:
    """Every offset at both pressures; exit code 1 where the truth passed the bound."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="noise of the doubles")
    parser.add_argument("--pressures", type=float, nargs="+", default=[3.9, 4.0], help="psi to inflate to")
    arguments = parser.parse_args()
    heading("offset psi", "to psi", "exit", "highest true psi", "message")
    tried = []
    for pressure_psi in arguments.pressures:
        for offset_psi in offsets_psi():
            one = inflate(offset_psi, pressure_psi, arguments.seed)
            tried.append(one)
            row(
                f"{offset_psi:+.2f}", f"{pressure_psi:g}", one.code, f"{one.highest_psi:.3f}", one.words[:100]
            )
    passed = [one for one in tried if not one.held]
    highest_psi = max(one.highest_psi for one in tried)
    print(f"\nhighest true pressure {highest_psi:.3f} psi in {len(tried)} inflations")
    print(f"above {BOUND_PSI} psi: {len(passed)}")
    return 1 if passed else 0


if __name__ == "__main__":
    sys.exit(main())
