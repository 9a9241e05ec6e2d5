"""Results and windows to and from plain JSON, to the last bit; the basis of a run's trials, from its record."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from labctl.config.rig import MarkerPoint
from labctl.ledger.records import RunRecord
from labctl.measurement.basis import Basis
from labctl.measurement.result import ClockFit, LevelResult, RelaxationResult, TrialResult
from labctl.measurement.windows import Window

Json = dict[str, Any]


def to_json(record: object) -> Json:
    """A record (a dataclass) as plain JSON: objects, lists, numbers, strings, booleans and null.

    Raises:
        ValueError: a number that JSON does not have (NaN, infinity).
    """
    plain: Json = _plain(record)
    return plain


def result_from_json(data: Mapping[str, Any]) -> TrialResult:
    """A trial's result as `to_json` wrote it."""
    clock, relaxation = data["clock"], data["relaxation"]
    return TrialResult(
        clock=None if clock is None else ClockFit(**clock),
        frame_residual_mm=data["frame_residual_mm"],
        levels=tuple(LevelResult(**_with_tuples(level)) for level in data["levels"]),
        relaxation=None if relaxation is None else RelaxationResult(**_with_tuples(relaxation)),
        problems=tuple(data["problems"]),
    )


def window_from_json(data: Mapping[str, Any]) -> Window:
    """A window as `to_json` wrote it."""
    return Window(**data)


def basis_of(run: RunRecord, pattern: str) -> Basis:
    """What a run's recordings of a pattern are judged by, from the run's record alone."""
    markers, measurement = run.rig["markers"], run.rig["measurement"]
    return Basis(
        points=tuple(MarkerPoint(**point) for point in markers["points"]),
        up=markers["up"],
        frequency_hz=float(markers["frequency_hz"]),
        tolerance_psi=float(run.rig["limits"]["hold_tolerance_psi"]),
        min_points=int(measurement["min_points"]),
        min_share=float(measurement["min_share"]),
        simulated_mm={
            float(level["pressure_psi"]): tuple(float(height) for height in level["heights_mm"])
            for level in run.simulated_heights
            if level["pattern"] == pattern
        },
    )


def _with_tuples(data: Mapping[str, Any]) -> Json:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in data.items()}


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever a record holds
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value} has no place in a record: JSON has no such number")
    return value
