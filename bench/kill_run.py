"""kill -9 at random moments of a run: what is lost, what is repeated, and whether the rig is safe.

Doubles run in a process of their own, so they outlive each kill as real instruments would. A run of five-trial is
begun, killed, gone on with (`--continue`), killed again, and so on; after a finished run comes a new one. After each
kill:

- every trial that the killed process had printed on standard output must be in the ledger (lost: must be 0);
- the ledger must open, in SQLite's own judgement too (unreadable: must be 0);
- by the doubles' trace the rig must come to SAFE (unsafe: must be 0; and how long it took);
- of the work of that process at most one trial may be without a record (repeated: must be at most 1).

At the end every unfinished run is finished and every run is verified from its raw files. `--seed` repeats the
moments.
"""

import argparse
import json
import random
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

from labctl.ledger.ledger import Ledger

LABCTL = [sys.executable, "-m", "labctl"]
LONGEST_LIFE_S = 12.0
SAFE_WITHIN_S = 15.0
_TRIAL = re.compile(r"trial (\d+) of \d+: (.*)")
_NUMBER = re.compile(r"trial \d+: | \(.*\)")
_RUN = re.compile(r"run (\d+):")


@dataclass
class Tally:
    """What came of the kills."""

    kills: int = 0
    finished_before: int = 0
    printed: int = 0
    lost: list[str] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)
    unsafe: list[str] = field(default_factory=list)
    ended_by_themselves: list[str] = field(default_factory=list)
    recorded: int = 0
    most_repeated: int = 0
    safe_after_s: list[float] = field(default_factory=list)
    during: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Place:
    """Where everything lies."""

    folder: Path
    speed: float

    @property
    def rig(self) -> Path:
        """The doubles' rig.toml."""
        return self.folder / "rig.toml"

    @property
    def trace(self) -> Path:
        """The doubles' truth."""
        return self.folder / "trace.jsonl"

    @property
    def ledger(self) -> Path:
        """The ledger's folder."""
        return self.folder / "ledger"


def main() -> int:
    """Run the kills and print what came of them; 0 when nothing was lost."""
    arguments = _arguments()
    seed = random.SystemRandom().randrange(2**32) if arguments.seed is None else arguments.seed
    print(f"seed {seed}, {arguments.kills} kills, doubles at speed {arguments.speed:g}", flush=True)
    moments = random.Random(seed)  # noqa: S311 - moments, not secrets
    with tempfile.TemporaryDirectory(prefix="labctl-kill-") as folder:
        place = Place(Path(folder), arguments.speed)
        doubles = _serve(place)
        tally = Tally()
        try:
            while tally.kills < arguments.kills:
                _one_life(place, moments.uniform(0.0, LONGEST_LIFE_S), tally)
                if tally.kills % 10 == 0:
                    _print_tally(tally)
            verified = _finish_and_verify(place)
        finally:
            doubles.terminate()
            doubles.wait(20)
        _print_tally(tally)
        unfinished = _unfinished(place)
    print("killed during: " + "; ".join(f"{step} {count}" for step, count in sorted(tally.during.items())))
    print(f"unfinished at the end: {unfinished or 'none'}")
    print(f"runs finished afterwards and verified from their raw files: {verified}")
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps({"seed": seed, **asdict(tally), "verified": verified}, indent=1))
    good = not (tally.lost or tally.unreadable or tally.unsafe) and tally.most_repeated <= 1
    return 0 if good and all(verified.values()) and not unfinished else 1


def _one_life(place: Place, life_s: float, tally: Tally) -> None:
    """Begin a run or continue the last one, and kill it after `life_s`."""
    unfinished = _unfinished(place)
    which = ["--continue", str(unfinished[-1])] if unfinished else ["five-trial", "--pattern", "sphere"]
    before = _begun(place)
    process = subprocess.Popen(
        [*LABCTL, "run", *which, "--rig", str(place.rig), "--ledger", str(place.ledger)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=life_s)
        if process.returncode != 0:
            row = _last_row(place)
            # A trip, say of a run that a busy machine made late, is no rig that is not SAFE.
            ended = tally.ended_by_themselves if row is not None and _is_safe(row) else tally.unsafe
            ended.append(f"life {tally.kills}: ended by itself with {process.returncode}: {err[-500:]}")
        tally.finished_before += 1
    except subprocess.TimeoutExpired:
        killed_s = time.time()
        process.send_signal(signal.SIGKILL)
        out, err = process.communicate()
        tally.kills += 1
        step = _last_step(err)
        tally.during[step] = tally.during.get(step, 0) + 1
        _wait_safe(place, killed_s, tally)
    _check_ledger(place, out, before, tally)


def _last_step(err: str) -> str:
    """What was going on: the last step that was shown, without its trial's number."""
    steps = [line.removeprefix("... ") for line in err.splitlines() if line.startswith("... ")]
    return _NUMBER.sub("", steps[-1]) if steps else "starting"


def _check_ledger(place: Place, out: str, begun_before: int, tally: Tally) -> None:
    printed = _TRIAL.findall(out)
    tally.printed += len(printed)
    if not (place.ledger / "ledger.sqlite").exists():
        if printed:
            tally.lost.append("a trial was printed and there is no ledger")
        return
    try:
        with sqlite3.connect(place.ledger / "ledger.sqlite") as database:
            (verdict,) = database.execute("PRAGMA integrity_check").fetchone()
        database.close()
        if verdict != "ok":
            tally.unreadable.append(f"kill {tally.kills}: {verdict}")
        with _open(place) as ledger:
            runs = ledger.runs()
            records = [record for run in runs for record in ledger.trials(run.number)]
            begun = sum(event.kind == "trial-begun" for run in runs for event in ledger.events(run.number))
    except Exception as error:
        tally.unreadable.append(f"kill {tally.kills}: {error!r}")
        return
    number = _RUN.search(out)
    for trial, outcome in printed:
        same = [
            record
            for record in records
            if number
            and record.run == int(number[1])
            and record.number == int(trial)
            and (record.outcome == "good") == ("e_t" in outcome)
        ]
        if not same:
            tally.lost.append(f"kill {tally.kills}: trial {trial} ({outcome})")
    recorded_now = len(records) - tally.recorded
    tally.recorded = len(records)
    tally.most_repeated = max(tally.most_repeated, begun - begun_before - recorded_now)


def _begun(place: Place) -> int:
    if not (place.ledger / "ledger.sqlite").exists():
        return 0
    with _open(place) as ledger:
        events = [event for run in ledger.runs() for event in ledger.events(run.number)]
    return sum(event.kind == "trial-begun" for event in events)


def _unfinished(place: Place) -> list[int]:
    if not (place.ledger / "ledger.sqlite").exists():
        return []
    with _open(place) as ledger:
        return [
            run.number
            for run in ledger.runs()
            if not any(event.kind == "finished" for event in ledger.events(run.number))
        ]


def _open(place: Place) -> Ledger:
    return Ledger.open(place.ledger, lambda text: print(f"  ledger: {text}", flush=True))


def _wait_safe(place: Place, killed_s: float, tally: Tally) -> None:
    """Wait until the doubles' truth is SAFE; the trace's rows carry the wall's time."""
    end_s = time.monotonic() + SAFE_WITHIN_S
    while time.monotonic() < end_s:
        row = _last_row(place)
        if row is not None and time.time() - killed_s > 0.3 and _is_safe(row):
            tally.safe_after_s.append(round(time.time() - killed_s, 2))
            # The guard gives the ports back after it has read SAFE.
            time.sleep(1.0)
            return
        time.sleep(0.05)
    tally.unsafe.append(f"kill {tally.kills}: {_last_row(place)}")


def _is_safe(row: dict) -> bool:
    return row["setpoint_psi"] == 0 and row["pressure_psi"] < 0.3 and not row["coils"]


def _last_row(place: Place) -> dict | None:
    with place.trace.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - 4096))
        lines = file.read().split(b"\n")
    whole = [line for line in lines[1:-1] if line.strip()]
    return json.loads(whole[-1]) if whole else None


def _finish_and_verify(place: Place) -> dict[int, bool]:
    for number in _unfinished(place):
        where = ["--rig", str(place.rig), "--ledger", str(place.ledger)]
        ended = subprocess.run(
            [*LABCTL, "run", "--continue", str(number), *where], check=False, capture_output=True, text=True
        )
        if ended.returncode != 0:
            print(
                f"run {number} could not be finished (exit code {ended.returncode}): {ended.stderr[-1500:]}"
            )
    with _open(place) as ledger:
        numbers = [run.number for run in ledger.runs()]
    return {
        number: subprocess.run(
            [*LABCTL, "verify", str(number), "--ledger", str(place.ledger)], check=False, capture_output=True
        ).returncode
        == 0
        for number in numbers
    }


def _serve(place: Place) -> subprocess.Popen[str]:
    options = ["--out", str(place.rig), "--speed", str(place.speed), "--trace", str(place.trace), "--json"]
    process = subprocess.Popen(
        [*LABCTL, "doubles", "serve", *options],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None  # noqa: S101 - opened as a pipe
    process.stdout.readline()
    return process


def _print_tally(tally: Tally) -> None:
    slowest = max(tally.safe_after_s, default=0.0)
    print(
        f"{tally.kills} kills: {tally.printed} trials printed, {len(tally.lost)} lost, {len(tally.unreadable)} "
        f"ledgers unreadable, {len(tally.unsafe)} times not SAFE (slowest {slowest:.1f} s), at most "
        f"{tally.most_repeated} trial repeated, {tally.finished_before} runs came to their end first, "
        f"{len(tally.ended_by_themselves)} ended by themselves",
        flush=True,
    )
    for problem in (*tally.lost, *tally.unreadable, *tally.unsafe, *tally.ended_by_themselves):
        print(f"  {problem}", flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, help="of the moments; drawn and printed without it")
    parser.add_argument("--speed", type=float, default=20.0, help="of the doubles' time")
    parser.add_argument("--out", type=Path, help="a JSON file for everything that was counted")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
