"""The steps that protocols are made of.

Each returns a `Step`: its line of the checklist, how long it lasts and may last, what it does.
"""

from collections import deque
from collections.abc import Callable, Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from labctl.config.rig import RigConfig
from labctl.errors import InstrumentError, Unsafe
from labctl.instruments.readings import PressureReading
from labctl.measurement.windows import Window
from labctl.mocap.gate import gate
from labctl.mocap.window import average
from labctl.session.contract import Bench, Step

# A fortieth of the usual inflation: what is left of it moves no marker by more than the noise.
_UNINFLATED_PSI = 0.1
# An exchange with an instrument, a reading that is waited for: what a step takes beside its waits.
_MARGIN_S = 10.0
_USUAL_VENT_S = 3.0
_USUAL_READING_S = 1.0
_USUAL_STILL_S = 20.0
# What one look at the sheet is averaged over, so that the cameras' noise does not pass for movement.
_LOOK_S = 1.0


def wait_until_uninflated(rig: RigConfig) -> Step:
    """No pressure is left."""

    def do(bench: Bench) -> None:
        bench.rig.fall_below(_UNINFLATED_PSI)

    return Step(
        f"wait until less than {_UNINFLATED_PSI:g} psi are left",
        _USUAL_READING_S,
        rig.limits.vent_timeout_s + _MARGIN_S,
        do,
    )


def wait_until_relaxed(rig: RigConfig) -> Step:
    """No pressure is left, and the sheet has come to rest since the shape before."""
    uninflated = wait_until_uninflated(rig)

    def do(bench: Bench) -> None:
        uninflated.do(bench)
        _wait_until_still(bench, rig.measurement.relax_timeout_s, "relax_timeout")

    limits = rig.measurement
    return Step(
        f"wait until the sheet has relaxed (moves less than {limits.still_mm:g} mm in {limits.still_over_s:g} s)",
        lasts_s=_USUAL_STILL_S,
        deadline_s=limits.relax_timeout_s + uninflated.deadline_s,
        do=do,
    )


def capture_baseline(rig: RigConfig) -> Step:
    """The uninflated sheet: the baseline that fixes the sheet frame."""

    def do(bench: Bench) -> None:
        start_s = bench.rig.clock.now_s()
        bench.rig.capture(rig.limits.capture_s)
        bench.mark_window(Window("baseline", start_s, bench.rig.clock.now_s()))

    return _capturing("capture the uninflated sheet", rig, do)


def jam(channels: Collection[int], pattern: str) -> Step:
    """The pattern's valves, opened and read back."""
    on = frozenset(channels)

    def do(bench: Bench) -> None:
        bench.rig.jam(on)
        bench.rig.start_control()

    listed = ", ".join(map(str, sorted(on)))
    return Step(
        f"jam {pattern} (channels {listed}) and read the valves back", 0.5, _MARGIN_S, do, channels=on
    )


def ramp(pressure_psi: float, rig: RigConfig, from_psi: float = 0.0) -> Step:
    """Up to the pressure at the rig's rate."""

    def do(bench: Bench) -> None:
        bench.rig.ramp_to(pressure_psi, lambda reading: _show(bench, reading), from_psi)

    lasts_s = abs(pressure_psi - from_psi) / rig.limits.ramp_psi_per_s
    return Step(
        f"ramp to {pressure_psi:.2f} psi at {rig.limits.ramp_psi_per_s:g} psi/s",
        lasts_s,
        2 * lasts_s + _MARGIN_S,
        do,
        pressure_psi,
    )


def hold_pressure(pressure_psi: float, rig: RigConfig, hold_s: float | None = None) -> Step:
    """The pressure stays within its band, for `hold_s` at least where that is given."""
    limits = rig.limits

    def do(bench: Bench) -> None:
        settled = bench.rig.settle(pressure_psi, lambda reading: _show(bench, reading))
        if hold_s is not None:
            bench.rig.hold(pressure_psi, settled.times_s[0] + hold_s, lambda reading: _show(bench, reading))

    return Step(
        f"hold {pressure_psi:.2f} +- {limits.hold_tolerance_psi:g} psi {_until(hold_s, 'the pressure has settled')}",
        max(limits.settle_s, hold_s or 0.0),
        limits.settle_timeout_s + (hold_s or 0.0) + _MARGIN_S,
        do,
        pressure_psi,
    )


def hold_until_settled(pressure_psi: float, rig: RigConfig, hold_s: float | None = None) -> Step:
    """The pressure stays within its band, for `hold_s` at least where that is given, and the sheet has its shape."""
    hold = hold_pressure(pressure_psi, rig, hold_s)

    def do(bench: Bench) -> None:
        hold.do(bench)
        _wait_until_still(bench, rig.measurement.shape_timeout_s, "shape_timeout")

    return Step(
        f"hold {pressure_psi:.2f} +- {rig.limits.hold_tolerance_psi:g} psi "
        f"{_until(hold_s, 'pressure and shape have settled')}",
        hold.lasts_s + _USUAL_STILL_S,
        hold.deadline_s + rig.measurement.shape_timeout_s,
        do,
        pressure_psi,
    )


def capture_level(pressure_psi: float, rig: RigConfig) -> Step:
    """A window of markers while the pressure holds."""

    def do(bench: Bench) -> None:
        start_s = bench.rig.clock.now_s()
        _, hold = bench.rig.capture(rig.limits.capture_s)
        bench.mark_window(Window("level", start_s, bench.rig.clock.now_s(), pressure_psi))
        bench.show_progress(f"{hold.mean_psi:.2f} psi")

    return _capturing(f"capture the sheet at {pressure_psi:.2f} psi", rig, do, pressure_psi)


def vent_and_unjam(rig: RigConfig) -> Step:
    """Setpoint 0, exhaust open, every valve off, no pressure left: SAFE, read back."""

    def do(bench: Bench) -> None:
        report = bench.rig.make_safe()
        if not report.safe:
            raise Unsafe(report.describe())

    return Step(
        "vent, unjam, and read SAFE back", _USUAL_VENT_S, rig.limits.vent_timeout_s + 2 * _MARGIN_S, do
    )


def watch_the_sheet_relax(seconds: float) -> Step:
    """Record the vented sheet on its way back."""

    def do(bench: Bench) -> None:
        start_s = bench.rig.clock.now_s()
        bench.rig.wait(seconds)
        bench.mark_window(Window("relaxing", start_s, bench.rig.clock.now_s()))

    return Step(f"record the sheet for {seconds:g} s after venting", seconds, seconds + _MARGIN_S, do)


def _until(hold_s: float | None, settled: str) -> str:
    return f"until {settled}" if hold_s is None else f"for {hold_s:g} s, and until {settled}"


def _capturing(
    description: str, rig: RigConfig, do: Callable[[Bench], None], pressure_psi: float | None = None
) -> Step:
    return Step(description, rig.limits.capture_s, rig.limits.capture_s + _MARGIN_S, do, pressure_psi)


def _wait_until_still(bench: Bench, timeout_s: float, setting: str) -> None:
    """Return when the markers have moved by less than the rig's `still_mm` over its `still_over_s`.

    Raises:
        InstrumentError: they had not within `timeout_s`, or too few of them were seen all that time.
    """
    limits, clock = bench.rig.config.measurement, bench.rig.clock
    end_s = clock.now_s() + timeout_s
    seen: deque[tuple[float, NDArray[np.float64]]] = deque()
    while True:
        place_mm = _mean_mm(bench)
        seen.append((clock.now_s(), place_mm))
        while len(seen) > 1 and seen[-1][0] - seen[1][0] >= limits.still_over_s:
            seen.popleft()
        moved_mm, span_s = _moved_mm(seen[0][1], place_mm), seen[-1][0] - seen[0][0]
        if span_s >= limits.still_over_s:
            _require_seen(bench, [place_mm for _, place_mm in seen])
            if moved_mm < limits.still_mm:
                return
            bench.show_progress(f"moved {moved_mm:.2f} mm in {span_s:.0f} s")
        if clock.now_s() > end_s:
            raise InstrumentError(
                f"the sheet was not still within {timeout_s:g} s: it moved {moved_mm:.3f} mm (root mean square) in "
                f"{span_s:.1f} s, and {limits.still_mm:g} mm is the limit; look for a leak, or raise "
                f"measurement.still_within or measurement.{setting}"
            )


def _require_seen(bench: Bench, places_mm: Sequence[NDArray[np.float64]]) -> None:
    """Refuse to wait on for markers of which too few were ever seen: a pressurised sheet is no place to wait."""
    limits = bench.rig.config.measurement
    most = max(int(np.isfinite(place_mm[:, 0]).sum()) for place_mm in places_mm)
    if most < limits.min_points:
        raise InstrumentError(
            f"{most} of {len(places_mm[0])} markers were seen at most for {limits.still_over_s:g} s, and at least "
            f"{limits.min_points} are needed (measurement.min_points); clear the cameras' view"
        )


def _mean_mm(bench: Bench) -> NDArray[np.float64]:
    config = bench.rig.config
    frames, _ = bench.rig.capture(_LOOK_S)
    ids = [point.id for point in config.markers.points]
    # One frame at 0, 0, 0 would pass for a sheet that moves.
    return average(gate(frames, ids).frames, ids, config.measurement.min_share).mean_mm


def _moved_mm(before_mm: NDArray[np.float64], after_mm: NDArray[np.float64]) -> float:
    """Root mean square distance of the markers seen in both; infinite where there are none."""
    squares = ((after_mm - before_mm) ** 2).sum(axis=1)
    seen = squares[np.isfinite(squares)]
    return float(np.sqrt(seen.mean())) if len(seen) else float("inf")


def _show(bench: Bench, reading: PressureReading) -> None:
    bench.show_progress(f"{reading.gauge_psi:.2f} psi")
