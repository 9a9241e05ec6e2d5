"""`labctl vent` and `labctl abort` from a second terminal, in every step of every command that pressurises a sheet.

For each command, step and condition of its process (healthy; busy: its main thread computes; stopped: SIGSTOP; gone:
kill -9) the command is started on doubles in a process of their own, brought to the step and put into the condition,
and the word is typed in another folder. By the doubles' trace the setpoint must be 0, and stay so, within 0.5 s of
then (2 s where the process does not answer), less what a bare interpreter takes to start, and the word must have
printed SAFE as read back. A machine that is busy with other things shows in that.

`--command`, `--condition` and `--step` leave out the rest. Words alternate from case to case; `--both` tries both.
"""

import argparse
import itertools
import json
import os
import re
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from bench_report import heading, machine, row

LABCTL = [sys.executable, "-m", "labctl"]
COMMANDS = {
    "inflate": ["inflate", "--pattern", "sphere"],
    "five-trial": ["run", "five-trial", "--pattern", "sphere", "--trials", "2"],
    "pressure-sweep": ["run", "pressure-sweep", "--pattern", "sphere", "--trials", "1"],
    "relaxation": ["run", "relaxation", "--pattern", "sphere", "--trials", "1", "--watch", "60 s"],
    "layering": ["run", "layering", "--pattern", "cylinder", "--pattern", "sphere", "--trials", "1"],
    "calibration": ["run", "calibration", "--pattern", "cylinder", "--trials", "1"],
}
STEPS = [
    "simulating",
    "opening",
    "taking the rig",
    "trial 1: wait",
    "trial 1: capture the un",
    "trial 1: jam",
    "trial 1: ramp",
    "trial 1: hold",
    "trial 1: capture the sheet",
    "trial 1: vent",
    "trial 2: wait",
]
RELAXING = "trial 1: record"
CONDITIONS = ("healthy", "busy", "stopped", "gone")
WITHIN_S = {"healthy": 0.5, "busy": 0.5, "stopped": 2.0, "gone": 2.0}
_STEP_S = 120.0
_WORD_S = 60.0
_BUSY_S = 20.0
_AFTER_S = 0.3


@dataclass
class Tally:
    """What was seen in one condition."""

    cases: int = 0
    after_s: list[float] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


def main() -> int:
    """Try them all and print what came of them; 0 when every case was as it must be."""
    arguments = _arguments()
    if arguments.busy_at is not None:
        return _busy_labctl(arguments.busy_at, arguments.rest)
    cases = list(_cases(arguments))
    print(f"Machine: {machine()}. {len(cases)} cases, doubles at speed {arguments.speed:g}.", flush=True)
    tallies = {condition: Tally() for condition in CONDITIONS}
    with tempfile.TemporaryDirectory(prefix="lab") as folder:
        place = Path(folder)
        doubles = _serve(place, arguments.speed)
        try:
            for number, (command, step, condition, word) in enumerate(cases, 1):
                problem, after_s = _one_case(place, command, step, condition, word)
                tally = tallies[condition]
                tally.cases += 1
                if after_s is not None:
                    tally.after_s.append(after_s)
                what = f"{word}, {command}, {step}, {condition}"
                if problem:
                    tally.failed.append(f"{what}: {problem}")
                shown = "setpoint was 0" if after_s is None else f"setpoint 0 after {after_s:.2f} s"
                print(f"{number:4} {what}: {problem or 'SAFE'}, {shown}", flush=True)
        finally:
            doubles.terminate()
            doubles.wait(20)
    return _print_tallies(tallies)


def _print_tallies(tallies: dict[str, Tally]) -> int:
    load, start_s = os.getloadavg()[1], _bare_start_s()
    print(f"\na bare interpreter starts in {start_s:.2f} s; load average of 5 minutes {load:.1f}\n")
    heading("process", "cases", "setpoint was up", "0 after at worst, s", "limit, s", "failed")
    for condition, tally in tallies.items():
        worst = f"{max(tally.after_s):.2f}" if tally.after_s else "-"
        row(condition, tally.cases, len(tally.after_s), worst, WITHIN_S[condition], len(tally.failed))
    failed = [problem for tally in tallies.values() for problem in tally.failed]
    for problem in failed:
        print(f"  {problem}")
    return 1 if failed else 0


def _cases(arguments: argparse.Namespace) -> Iterator[tuple[str, str, str, str]]:
    words = itertools.cycle(("vent", "abort"))
    for command in COMMANDS:
        # Two trials in five-trial only: between two trials is between two trials.
        steps = [step for step in STEPS if "trial 2" not in step or command == "five-trial"]
        for step in [*steps, *([RELAXING] if command == "relaxation" else [])]:
            for condition in CONDITIONS:
                wanted = (
                    arguments.command in (None, command)
                    and arguments.condition in (None, condition)
                    and (arguments.step or "") in step
                )
                if wanted:
                    for word in ("vent", "abort") if arguments.both else (next(words),):
                        yield command, step, condition, word


def _one_case(place: Path, command: str, step: str, condition: str, word: str) -> tuple[str, float | None]:
    """What was wrong, "" where nothing was; and when the setpoint was 0 after the word, None where it was before."""
    own = [*COMMANDS[command], "--rig", str(place / "rig.toml")]
    if command != "inflate":
        own += ["--ledger", str(place / "ledger")]
    head = [sys.executable, __file__, "--busy-at", step, "--"] if condition == "busy" else LABCTL
    process = subprocess.Popen(
        [*head, *own], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        if not _wait_for(process, step):
            return f"never came to {step!r}", None
        time.sleep(_AFTER_S if condition == "busy" else 0.05)
        if condition in ("stopped", "gone"):
            process.send_signal(signal.SIGSTOP if condition == "stopped" else signal.SIGKILL)
        return _type_word(place, condition, word)
    finally:
        # A process that is well ends by itself; nothing of a case may reach into the next.
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        assert process.stderr is not None  # noqa: S101 - opened as a pipe
        process.stderr.close()


def _type_word(place: Path, condition: str, word: str) -> tuple[str, float | None]:
    typed_s = time.monotonic()
    done = subprocess.run(
        [*LABCTL, word, "--rig", str(place / "rig.toml")],
        capture_output=True,
        text=True,
        timeout=_WORD_S,
        cwd=place / "elsewhere",
        check=False,
    )
    ended_s = time.monotonic()
    rows = [each for each in _rows(place / "trace.jsonl") if typed_s - 0.2 <= each["wall_s"] <= ended_s + 0.2]
    up_s = [each["wall_s"] for each in rows if each["setpoint_psi"] > 0]
    after_s = None if not up_s or up_s[-1] < typed_s else max(up_s) - typed_s
    if done.returncode or "SAFE, as read back" not in done.stdout:
        # Of a process that is gone the guard may have taken care before the word was heard.
        nobody = condition in ("gone", "stopped") and word == "abort" and "no labctl of yours" in done.stderr
        if not nobody:
            return f"exit code {done.returncode}: {done.stderr[-300:]}", after_s
    if after_s is not None and after_s - _bare_start_s() > WITHIN_S[condition]:
        return f"the setpoint was up for {after_s:.2f} s", after_s
    last = rows[-1] if rows else _rows(place / "trace.jsonl")[-1]
    if last["setpoint_psi"] or last["coils"] or last["pressure_psi"] > 0.3:
        return f"not SAFE by the trace: {last}", after_s
    return "", after_s


def _bare_start_s() -> float:
    start_s = time.monotonic()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    return time.monotonic() - start_s


def _wait_for(process: subprocess.Popen[bytes], step: str) -> bool:
    """Read standard error until the step is shown."""
    assert process.stderr is not None  # noqa: S101 - opened as a pipe
    shown, end_s = b"", time.monotonic() + _STEP_S
    while f"... {step}".encode() not in shown:
        ready, _, _ = select.select([process.stderr], [], [], max(0.0, end_s - time.monotonic()))
        data = os.read(process.stderr.fileno(), 65536) if ready else b""
        if not data:
            return False
        shown += data
    return True


def _rows(trace: Path) -> list[dict]:
    """The plant's truth of the last minute or so."""
    with trace.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - (1 << 21)))
        lines = file.read().split(b"\n")
    return [json.loads(line) for line in lines[1:-1] if line.endswith(b"}")]


def _serve(place: Path, speed: float) -> subprocess.Popen[str]:
    (place / "elsewhere").mkdir()
    options = ["--out", str(place / "rig.toml"), "--speed", str(speed), "--trace", str(place / "trace.jsonl")]
    process = subprocess.Popen(
        [*LABCTL, "doubles", "serve", *options, "--json"],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None  # noqa: S101 - opened as a pipe
    process.stdout.readline()
    return process


def _busy_labctl(step: str, arguments: list[str]) -> int:
    """Labctl, whose main thread computes for a while as soon as it has shown the step."""
    from labctl.cli import output
    from labctl.cli.main import run

    show = output.ProgressLine.show

    def show_and_compute(self: output.ProgressLine, shown: str, detail: str = "") -> None:
        show(self, shown, detail)
        if re.match(re.escape(step), shown) and not detail:
            end_s = time.monotonic() + _BUSY_S
            while time.monotonic() < end_s and sum(range(1000)):
                pass

    output.ProgressLine.show = show_and_compute  # type: ignore[method-assign]
    return run(arguments)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--speed", type=float, default=10.0, help="of the doubles' time")
    parser.add_argument("--command", choices=COMMANDS)
    parser.add_argument("--condition", choices=CONDITIONS)
    parser.add_argument("--step", help="a part of the step's words")
    parser.add_argument("--both", action="store_true", help="both words in every case")
    parser.add_argument("--busy-at", help=argparse.SUPPRESS)
    parser.add_argument("rest", nargs="*", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
