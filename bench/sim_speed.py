"""How fast the sheet simulator is: both solvers against the scalar oracle in one run, as a table (make bench-sim).

Everything is timed in this process on sheets with twelve random fibers, six of them jammed; compile times and
memory in processes of their own. Ratios count, not seconds: machines are noisy.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from bench_report import machine, row
from oracle.dynamic import dynamic as oracle_dynamic

from sim.equilibrium import equilibrium
from sim.fiber_voxels import Fiber, build_sheet
from sim.geometry import PUBLISHED, columns
from sim.inflation import RampAndHold
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.solve import solve_registered
from sim.solver import DEFAULT_STRAIN, Dynamic, Equilibrium, Solver

BATCH = 32
GOLDEN = Path(__file__).parents[1] / "fixtures" / "golden"
TINY = RampAndHold(0.01, read_at_s=1e-3)
FIRST_CALL = """
import time, numpy as np
from sim.sheet import Sheet
from sim.solver import Dynamic, Equilibrium
from sim.inflation import RampAndHold
material = np.zeros((28, 28, 3), np.int8)
material[0, 0, :2] = 2
solver = {solver}
started = time.perf_counter()
solver.solve([Sheet(material)])
print(time.perf_counter() - started)
"""
MEMORY = """
import sys
sys.path.insert(0, {here!r})
from sim_speed import BATCH, Dynamic, Equilibrium, peak_mib, random_sheets
{solver}.solve(random_sheets(BATCH))
print(peak_mib())
"""


def random_fiber(rng: np.random.Generator) -> Fiber:
    """A fiber of 60 mm or more between two columns of the published sheet."""
    places = np.argwhere(columns(PUBLISHED))
    while True:
        a, b = (tuple(PUBLISHED.to_sheet_m(int(n)) for n in rng.choice(places)) for _ in range(2))
        if np.hypot(a[0] - b[0], a[1] - b[1]) >= 0.06:
            return Fiber(("top", "bottom")[rng.integers(2)], a, b)


def random_sheets(count: int, seed: int = 1) -> list[Sheet]:
    """Sheets with twelve random fibers, the first six jammed."""
    rng = np.random.default_rng(seed)
    return [laid([random_fiber(rng) for _ in range(12)]) for _ in range(count)]


def laid(fibers: Sequence[Fiber]) -> Sheet:
    """The sheet with the first half of these fibers jammed."""
    return build_sheet(fibers, [n < len(fibers) // 2 for n in range(len(fibers))])


def seconds(run: Callable[[], object]) -> float:
    """How long a call takes."""
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


def on_cores(count: int) -> int:
    """Bind this process to so many of its cores; returns how many it got."""
    os.sched_setaffinity(0, sorted(ALL_CORES)[:count])
    return len(os.sched_getaffinity(0))


def solved_s(solver: Solver, sheets: Sequence[Sheet]) -> float:
    """Seconds a sheet of a batch; every sheet must have a shape."""
    shapes: list[object] = []
    took_s = seconds(lambda: shapes.extend(solver.solve(sheets)))
    if not all(isinstance(shape, Shape) for shape in shapes):
        sys.exit("a sheet of the benchmark has no shape")
    return took_s / len(sheets)


def single_s(sheets: Sequence[Sheet], starts: Sequence[Shape | None]) -> float:
    """Median seconds of equilibria one at a time."""
    return statistics.median(
        seconds(lambda: equilibrium(sheet, DEFAULT_STRAIN, start))  # noqa: B023 called at once
        for sheet, start in zip(sheets, starts, strict=True)
    )


def neighbours(count: int) -> tuple[list[Sheet], list[Shape | None]]:
    """Sheets, each with the resting shape of one that differs by one fiber."""
    rng = np.random.default_rng(2)
    sheets, starts = [], []
    for _ in range(count):
        fibers = [random_fiber(rng) for _ in range(12)]
        parent = equilibrium(laid(fibers), DEFAULT_STRAIN)
        fibers[rng.integers(6)] = random_fiber(rng)
        sheets.append(laid(fibers))
        starts.append(parent if isinstance(parent, Shape) else None)
    return sheets, starts


def golden_errors_mm(solver: Solver, key: str) -> list[float]:
    """Mean distance over the voxels from the reference engine, for each golden case."""
    errors = []
    for path in sorted(GOLDEN.glob("*.npz")):
        with np.load(path) as case:
            sheet, reference = Sheet(case["material"]), case[key]
        shape = solve_registered(sheet, solver)
        if isinstance(shape, Failure):
            sys.exit(f"{path.name} has no shape: {shape.summary}")
        errors.append(1e3 * float(np.linalg.norm(shape.positions_m - reference, axis=1).mean()))
    return errors


def in_a_process(code: str, **environment: str) -> float:
    """The number that a fresh interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | environment, check=True, capture_output=True, text=True
    )
    return float(done.stdout)


def peak_mib() -> float:
    """The most memory that this process ever held."""
    line = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")
    )
    return int(line.split()[1]) / 1024


def memory_mib(solver: str, in_flight: int) -> float:
    """The most memory of a process that solves the batch with so many sheets in flight at once."""
    code = MEMORY.format(here=str(Path(__file__).parent), solver=solver.format(in_flight))
    return in_a_process(code)


def main() -> None:
    """Time everything and print the table."""
    print(f"Machine: {machine()}.\n")
    sheets = random_sheets(BATCH)
    on_cores(1)
    oracle_dynamic(sheets[0], TINY)
    for precision in ("float32", "float64"):
        Dynamic(TINY, precision).solve(sheets[:1])
        Equilibrium(0.01, precision).solve(sheets[:1])

    row(
        "one core", "precision", "time a sheet", "times the oracle's speed", "golden cases, mean error, worst"
    )
    row("---", "---", "---", "---", "---")
    before_s = seconds(lambda: oracle_dynamic(sheets[0]))
    speeds: dict[str, float] = {}
    for precision in ("float32", "float64"):
        speeds[f"dynamic {precision}"] = solved_s(Dynamic(precision=precision, workers=1), sheets)
        speeds[f"equilibrium {precision}"] = solved_s(Equilibrium(precision=precision, workers=1), sheets)
    few = sheets[:15]
    alone_s = single_s(few, [None] * len(few))
    warm_s = single_s(*neighbours(15))
    # The machine's pace may have changed: the oracle before and after.
    oracle_s = statistics.mean([before_s, seconds(lambda: oracle_dynamic(sheets[1]))])
    row("scalar oracle, dynamic", "float64", f"{oracle_s:.2f} s", 1, "")
    for precision in ("float32", "float64"):
        for name, key in (("dynamic", "dynamic_positions_m"), ("equilibrium", "equilibrium_positions_m")):
            took_s = speeds[f"{name} {precision}"]
            solver = Dynamic(precision=precision) if name == "dynamic" else Equilibrium(precision=precision)
            worst_mm = max(golden_errors_mm(solver, key))
            figure = f"{took_s:.2f} s" if name == "dynamic" else f"{took_s * 1e3:.1f} ms"
            row(
                f"{name}, batch of {BATCH}",
                precision,
                figure,
                f"{oracle_s / took_s:.1f}",
                f"{worst_mm:.5f} mm",
            )
    row(
        "equilibrium, one sheet alone, cold",
        "float32",
        f"{alone_s * 1e3:.1f} ms",
        f"{oracle_s / alone_s:.0f}",
        "",
    )
    row(
        "equilibrium, warm, one fiber moved",
        "float32",
        f"{warm_s * 1e3:.1f} ms",
        f"{oracle_s / warm_s:.0f}",
        "",
    )

    print()
    cores = len(ALL_CORES)
    row(f"{cores} cores", "time a sheet", "times one core's speed")
    row("---", "---", "---")
    for name, one, every in (
        ("dynamic", Dynamic(workers=1), Dynamic()),
        ("equilibrium", Equilibrium(workers=1), Equilibrium()),
    ):
        batch = sheets * (1 if name == "dynamic" else 4)
        on_cores(1)
        before_s = solved_s(one, batch)
        on_cores(cores)
        took_s = solved_s(every, batch)
        on_cores(1)
        alone_s = statistics.mean([before_s, solved_s(one, batch)])
        on_cores(cores)
        row(f"{name}, float32, batch of {len(batch)}", f"{took_s * 1e3:.1f} ms", f"{alone_s / took_s:.2f}")

    print()
    row("memory and first call", "dynamic", "equilibrium")
    row("---", "---", "---")
    solvers = ("Dynamic(workers={0})", "Equilibrium(workers={0})")
    one_mib = [memory_mib(solver, 1) for solver in solvers]
    many_mib = [memory_mib(solver, BATCH) for solver in solvers]
    row("process, one sheet in flight", *(f"{mib:.0f} MiB" for mib in one_mib))
    each = [(many - one) / (BATCH - 1) for one, many in zip(one_mib, many_mib, strict=True)]
    row("each more sheet in flight", *(f"{mib:.2f} MiB" for mib in each))
    first, later = [], []
    for solver in ("Dynamic(RampAndHold(0.0, read_at_s=1e-4))", "Equilibrium(0.0)"):
        with tempfile.TemporaryDirectory() as cache:
            first.append(in_a_process(FIRST_CALL.format(solver=solver), NUMBA_CACHE_DIR=cache))
            later.append(in_a_process(FIRST_CALL.format(solver=solver), NUMBA_CACHE_DIR=cache))
    row("first call on a machine (compiles)", *(f"{s:.1f} s" for s in first))
    row("first call in a process after that", *(f"{s:.2f} s" for s in later))


ALL_CORES = os.sched_getaffinity(0)
if __name__ == "__main__":
    main()
