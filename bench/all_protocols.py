"""All five protocols to the end on doubles whose time runs fast, then verify and report of every run.

Each is run as a person would, `labctl run NAME` with its own numbers of trials, and each run is verified from its raw
files. Exit code 1 where anything failed or the protocols together took longer than `--limit` seconds.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_report import heading, machine, row

LABCTL = [sys.executable, "-m", "labctl"]
PROTOCOLS = {
    "five-trial": ["--pattern", "sphere"],
    "pressure-sweep": ["--pattern", "sphere"],
    "relaxation": ["--pattern", "sphere"],
    "layering": ["--pattern", "cylinder", "--pattern", "sphere"],
    "calibration": ["--pattern", "cylinder"],
}


def main() -> int:
    """Run them all and print how long each took."""
    arguments = _arguments()
    print(f"Machine: {machine()}. Doubles at speed {arguments.speed:g}.\n")
    heading("protocol", "seconds", "exit code", "verified", "last line")
    good, total_s = True, 0.0
    with tempfile.TemporaryDirectory(prefix="labctl-protocols-") as folder:
        ledger = arguments.ledger or Path(folder) / "ledger"
        for name, options in PROTOCOLS.items():
            start_s = time.monotonic()
            ran = _labctl("run", name, *options, "--speed", str(arguments.speed), "--ledger", str(ledger))
            took_s = time.monotonic() - start_s
            total_s += took_s
            verified = _labctl("verify", "last", "--ledger", str(ledger))
            good = good and ran.returncode == 0 and verified.returncode == 0
            printed = (ran.stdout if ran.returncode == 0 else ran.stderr).strip().splitlines()
            row(
                name,
                f"{took_s:.0f}",
                ran.returncode,
                verified.returncode == 0,
                printed[-1] if printed else "",
            )
    print(f"\nAll five: {total_s:.0f} s (limit {arguments.limit:g} s)")
    return 0 if good and total_s <= arguments.limit else 1


def _labctl(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*LABCTL, *arguments], capture_output=True, text=True, check=False)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--speed", type=float, default=20.0, help="of the doubles' time")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds for all five together")
    parser.add_argument("--ledger", type=Path, help="keep the runs here")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
