"""What a full marker stream costs the rig's process, and whether its supervisor stays on time (make bench-rig).

A marker server and a regulator with its valves run in processes of their own and answer byte for byte. This process
holds the sheet inflated under its supervisor and records everything; then the same with hardly any markers, for the
difference. CPU is that of all threads of this process, as a share of one core. With --busy N the full stream is
recorded twice beside N busy loops: the supervisor with real-time priority, where the system grants it, and without.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from bench_report import heading, machine, row

from labctl.config.design import Design, Fiber, SheetSpec
from labctl.config.load import load_rig
from labctl.config.rig import MarkerPoint, RigConfig
from labctl.doubles.markers import MarkerSettings
from labctl.doubles.serve import Doubles
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.sheet import Ladder
from labctl.instruments.readings import MarkerFrames
from labctl.ledger.raw.recording import RawRecorder, read_frames
from labctl.measurement.clock_fit import fit_clock
from labctl.rig import Rig
from labctl.rig.platform import SYSTEM, Platform
from labctl.safety.priority import Priority, ask_for_real_time, stay_ordinary
from labctl.safety.supervisor import POLL_PERIOD_S
from labctl.stop import OperatorStop

MARKERS = 72
FREQUENCY_HZ = 960.0
# What stands for no markers: the server sends no fewer.
IDLE_HZ = 1.0
# On the disk that runs are on, which a folder for temporary files may not be.
RECORDINGS = Path("runs")
PRESSURE_PSI = 2.0
CPU_BAR_PERCENT = 10.0
JITTER_BAR_MS = 2.0

POINTS = tuple(
    MarkerPoint(number, 26.0 + 11.0 * (number % 9), 31.5 + 11.0 * (number // 9)) for number in range(MARKERS)
)
DESIGN = Design(
    "rod",
    "bench",
    SheetSpec(140.0, "published", 3.9, 0.176),
    (Fiber("rod", "top", (70.0, 10.0), (70.0, 130.0), 4),),
    {"rod": frozenset({"rod"})},
)


class Bowl:
    """A sheet that rises at its rim; the simulator's shapes would load the machine."""

    def ladder(self, jammed: frozenset[str]) -> Ladder:
        """The same for every pattern."""
        flat_mm = np.array([(point.x_mm, point.y_mm, 0.0) for point in POINTS])
        rise_mm = np.zeros_like(flat_mm)
        rise_mm[:, 2] = np.hypot(flat_mm[:, 0] - 70, flat_mm[:, 1] - 70) / 10
        return Ladder(np.array([0.0, 0.2]), np.array([flat_mm, flat_mm + rise_mm]))

    def close(self) -> None:
        """Nothing is open."""


SLEEPER = f"""
import sys, threading, time
late_s, due_s, over = [], time.monotonic(), threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
while not over.is_set():
    late_s.append(time.monotonic() - due_s)
    due_s += {POLL_PERIOD_S}
    over.wait(max(0.0, due_s - time.monotonic()))
print(*late_s)
"""


@dataclass(frozen=True)
class Load:
    """One stretch of recording.

    `due` frames by the server's own times, from the first to the last; `late` is how late the supervisor's looks
    began, `machine_late` how late a process was that only sleeps at 20 Hz beside it: what the machine itself adds.
    """

    seconds: float
    due: int
    received: int
    recorded: int
    lost: int
    cpu_percent: float
    late_p50_ms: float
    late_p99_ms: float
    late_max_ms: float
    machine_late_p50_ms: float
    machine_late_p99_ms: float
    machine_late_max_ms: float
    delay_p99_ms: float
    raw_mb: float
    memory_mib: float


class Counter:
    """Counts the frames on their way to a recorder."""

    def __init__(self, recorder: RawRecorder) -> None:
        self.frames = 0
        self.take_pressure, self.fail = recorder.take_pressure, recorder.fail
        self._take_frames = recorder.take_frames

    def take_frames(self, frames: MarkerFrames) -> None:
        """Count and forward."""
        self.frames += len(frames)
        self._take_frames(frames)


def serve(rig_toml: Path) -> None:
    """Be a process of doubles until standard input closes; the rig's configuration is written to `rig_toml`."""
    settings = DoublesSettings(DESIGN, markers=MarkerSettings(points=POINTS, dropout=0.0))
    with Doubles(settings, shapes=Bowl()) as doubles:
        unfinished = rig_toml.with_suffix(".unfinished")
        unfinished.write_text(doubles.rig_toml())
        unfinished.rename(rig_toml)
        sys.stdin.read()


@contextmanager
def served(folder: Path, name: str) -> Iterator[RigConfig]:
    """Doubles in a process of their own."""
    path = folder / f"{name}.toml"
    process = subprocess.Popen([sys.executable, __file__, "--serve", str(path)], stdin=subprocess.PIPE)
    try:
        while not path.exists():
            if process.poll() is not None:
                sys.exit(f"the doubles of {name} did not start")
            time.sleep(0.05)
        yield load_rig(path)
    finally:
        process.communicate(timeout=30)


@contextmanager
def sleeping() -> Iterator[list[float]]:
    """A process that only sleeps, meanwhile; how late it woke each time, in ms, is there at the end."""
    late_ms: list[float] = []
    command = [sys.executable, "-c", SLEEPER]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield late_ms
    finally:
        printed, _ = process.communicate(timeout=30)
        late_ms += [1e3 * float(word) for word in printed.split()]


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """Processes that do nothing but compute, meanwhile."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(loops)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def record(config: RigConfig, seconds: float, folder: Path, platform: Platform = SYSTEM) -> Load:
    """Hold the sheet inflated and record for `seconds`."""
    stop = OperatorStop()
    with Rig(config, stop=stop, notify=print, platform=platform) as rig:
        rig.make_safe()
        rig.jam({4})
        rig.start_control()
        rig.ramp_to(PRESSURE_PSI, lambda _: None)
        rig.settle(PRESSURE_PSI, lambda _: None)
        recorder = RawRecorder(folder, f"raw/{config.markers.frequency_hz:g}-hz")
        counter = Counter(recorder)
        with rig.recording(counter):
            first_tick = len(rig._supervisor.late_s)
            started_s, started_cpu_s = time.monotonic(), time.process_time()
            with sleeping() as machine_late_ms:
                rig.wait(seconds)
            took_s = time.monotonic() - started_s
            cpu_s = time.process_time() - started_cpu_s
            late_ms = 1e3 * np.array(rig._supervisor.late_s)[first_tick:]
    machine_ms = np.array(machine_late_ms)
    raw = recorder.finish()
    memory_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    frames = read_frames(folder / raw["frames"].path)
    fit = fit_clock(frames.time_s, frames.arrival_s, config.markers.frequency_hz)
    return Load(
        seconds=took_s,
        due=fit.frames + fit.lost,
        received=counter.frames,
        recorded=len(frames),
        lost=fit.lost,
        cpu_percent=100 * cpu_s / took_s,
        late_p50_ms=float(np.percentile(late_ms, 50)),
        late_p99_ms=float(np.percentile(late_ms, 99)),
        late_max_ms=float(late_ms.max()),
        machine_late_p50_ms=float(np.percentile(machine_ms, 50)),
        machine_late_p99_ms=float(np.percentile(machine_ms, 99)),
        machine_late_max_ms=float(machine_ms.max()),
        delay_p99_ms=1e3 * fit.delay_p99_s,
        raw_mb=raw["frames"].size_bytes / 1e6,
        memory_mib=memory_mib,
    )


def report(name: str, load: Load) -> None:
    """A line of the table."""
    late = f"{load.late_p50_ms:.2f} / {load.late_p99_ms:.2f} / {load.late_max_ms:.2f}"
    slept = (
        f"{load.machine_late_p50_ms:.2f} / {load.machine_late_p99_ms:.2f} / {load.machine_late_max_ms:.2f}"
    )
    row(
        name,
        f"{load.seconds:.0f} s",
        f"{load.due} / {load.received} / {load.recorded} / {load.lost}",
        f"{load.cpu_percent:.1f} %",
        late,
        slept,
        f"{load.delay_p99_ms:.1f} ms",
        f"{load.raw_mb:.1f} MB",
        f"{load.memory_mib:.0f} MiB",
    )


def record_beside(loops: int, config: RigConfig, seconds: float, folder: Path) -> dict[str, Load]:
    """The full stream beside busy loops, with and without the priority, each as a line of the table."""
    # What is measured is what a late computer does: it must not be refused here.
    limits = replace(config.limits, warn_lateness_s=0.5, max_lateness_s=1.0, stale_after_s=2.0)
    config = replace(config, limits=limits)
    granted: list[Priority] = []

    def prioritise() -> Priority:
        granted.append(ask_for_real_time())
        return granted[-1]

    found = {}
    with busy(loops):
        for name, ask in (("with", prioritise), ("without", stay_ordinary)):
            found[name] = record(config, seconds, folder, replace(SYSTEM, prioritise=ask))
            report(f"{FREQUENCY_HZ:g} Hz beside {loops} busy loops, {name} priority", found[name])
    print(f"\nPriority: {granted[0].text}.")
    return found


def main() -> None:
    """Run both stretches and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of the full stream")
    parser.add_argument("--busy", type=int, default=0, help="busy loops beside it, with and without priority")
    parser.add_argument("--out", type=Path, help="write the numbers here, as JSON")
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve is not None:
        serve(options.serve)
        return
    RECORDINGS.mkdir(exist_ok=True)
    with ExitStack() as opened:
        folder = Path(opened.enter_context(tempfile.TemporaryDirectory(dir=RECORDINGS)))
        config = opened.enter_context(served(folder, "regulator"))
        markers = opened.enter_context(served(folder, "markers")).markers
        print(f"Machine: {machine()}. {MARKERS} markers.\n")
        heading(
            "stream",
            "recorded for",
            "frames due / received / recorded / lost",
            "CPU of one core",
            "tick late by p50 / p99 / worst, ms",
            "a bare sleeper's",
            "frame on the way, p99",
            "raw file",
            "most memory",
        )
        idle = record(
            replace(config, markers=replace(markers, frequency_hz=IDLE_HZ)), options.seconds / 10, folder
        )
        report(f"{IDLE_HZ:g} Hz", idle)
        full = record(
            replace(config, markers=replace(markers, frequency_hz=FREQUENCY_HZ)), options.seconds, folder
        )
        report(f"{FREQUENCY_HZ:g} Hz", full)
        beside = (
            record_beside(
                options.busy,
                replace(config, markers=replace(markers, frequency_hz=FREQUENCY_HZ)),
                options.seconds,
                folder,
            )
            if options.busy
            else {}
        )
    ingest_percent = full.cpu_percent - idle.cpu_percent
    print(
        f"\nIngest: {ingest_percent:.1f} % of one core beside the control loop ({CPU_BAR_PERCENT:g} % at most),"
    )
    print(
        f"{1e4 * ingest_percent * full.seconds / full.recorded:.0f} us a frame; {full.lost} frames lost; the"
    )
    print(
        f"supervisor's 20 Hz late by {full.late_p99_ms:.2f} ms at the 99th percentile ({JITTER_BAR_MS:g} ms at most)."
    )
    if options.out is not None:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        numbers: dict[str, object] = {
            "machine": machine(),
            "markers": MARKERS,
            "idle": asdict(idle),
            "full": asdict(full),
        }
        numbers["beside_busy_loops"] = {name: asdict(load) for name, load in beside.items()}
        options.out.write_text(json.dumps(numbers | {"ingest_percent": ingest_percent}, indent=2) + "\n")


if __name__ == "__main__":
    main()
