"""Gauges that freeze, at any pressure, in ramp and in hold: how high the sheet is driven, by the doubles' own truth.

Every case is an inflation to 3.9 psi in virtual time on doubles of the design "known", through the real drivers and
links. `--seeds` noises each; exit code 1 where the highest true pressure of any case is above `--limit`. Then as many
healthy inflations must not trip.
"""

import argparse
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from bench_report import heading, row

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from virtual_labctl import SharedShapes
from virtual_rig import VirtualRig

from labctl.config.load import load_design
from labctl.doubles.markers import MarkerSettings
from labctl.errors import LabError
from labctl.rig import Rig
from labctl.stop import OperatorStop

TARGET_PSI = 3.9
RAMP_S = 4.0
# Few frames bear witness later: it is printed, and held to no limit.
_WEAK = "frozen at 3.88 psi, 30 Hz"


@dataclass(frozen=True)
class Case:
    """One fault, or none; `hold_s` is how long the pressure is held."""

    name: str
    fault: str | None
    seed: int
    hold_s: float
    ramp: str = "1 psi/s"
    cameras: MarkerSettings = field(default_factory=MarkerSettings)
    frequency: str = "240 Hz"


@dataclass(frozen=True)
class Outcome:
    """How high it went, and how it ended."""

    highest_psi: float
    ended: str


def inflate(case: Case, channels: frozenset[int]) -> Outcome:
    """One inflation to the end of its hold, or of the rig."""
    virtual = VirtualRig(
        *([case.fault] if case.fault else []),
        design=load_design("known"),
        shapes=SharedShapes(),
        seed=case.seed,
        markers=case.cameras,
        change=lambda text: _changed(text, case),
    )
    ended = "held"
    try:
        with Rig(
            virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform
        ) as rig:
            rig.make_safe()
            rig.wait(1.0)
            rig.jam(channels)
            rig.start_control()
            rig.ramp_to(TARGET_PSI, lambda _: None)
            rig.wait(case.hold_s)
    except LabError as error:
        ended = str(error)
    finally:
        highest_psi = virtual.plant.highest_psi
        virtual.close()
    return Outcome(highest_psi, ended)


def _changed(text: str, case: Case) -> str:
    # A gauge that stands still reads no vent: how long one waits for it is not the question here.
    limits = f'[limits]\nramp = "{case.ramp}"\nvent_timeout = "1 s"'
    text = re.sub(r"^frequency_hz.*$", f'frequency_hz = "{case.frequency}"', text, flags=re.MULTILINE)
    return text.replace("[limits]", limits)


def main() -> int:
    """Print the worst of each kind."""
    arguments = _arguments()
    design = load_design("known")
    channels = design.channels("sphere")
    good = True
    heading("gauge", "cases", "highest true pressure, psi", "at", "held to the end", "how the worst ended")
    for name, cases in _kinds(arguments.seeds, arguments.hold):
        if arguments.only not in name:
            continue
        outcomes = [(inflate(case, channels), case) for case in cases]
        worst, case = max(outcomes, key=lambda each: each[0].highest_psi)
        held = sum(outcome.ended == "held" for outcome, _ in outcomes)
        good = good and (worst.highest_psi < arguments.limit or name == _WEAK)
        good = good and (held == len(outcomes) or not name.startswith("healthy"))
        row(name, len(outcomes), f"{worst.highest_psi:.2f}", case.name, held, worst.ended[:90])
        if arguments.every:
            for outcome, each in outcomes:
                print(f"    {each.name} seed {each.seed}: {outcome.highest_psi:.2f} {outcome.ended[:70]}")
        sys.stdout.flush()
    return 0 if good else 1


def _kinds(seeds: int, hold_s: float) -> Iterator[tuple[str, list[Case]]]:
    def each(name: str, fault: str | None, hold_s: float, ramp: str = "1 psi/s") -> list[Case]:
        return [Case(name, fault, seed, hold_s, ramp) for seed in range(seeds)]

    yield (
        "frozen in the ramp",
        [
            case
            for step in range(round((3.95 - 0.2) / 0.05) + 1)
            for case in each(
                f"{0.2 + 0.05 * step:.2f} psi", f"regulator=frozen-sensor@{0.2 + 0.05 * step:.2f}psi", hold_s
            )
        ],
    )
    yield (
        "frozen in the hold",
        [
            case
            for second in range(1, 21)
            for case in each(
                f"{second / 2:g} s of the hold",
                f"regulator=frozen-sensor@{2.5 + RAMP_S + second / 2}",
                hold_s + 10,
            )
        ],
    )
    for ramp in ("0.1 psi/s", "0.5 psi/s", "1.4 psi/s"):
        yield (
            f"frozen in a ramp of {ramp}",
            [
                case
                for psi in (1.0, 3.7, 3.8, 3.85, 3.87, 3.89)
                for case in each(f"{psi:g} psi", f"regulator=frozen-sensor@{psi}psi", hold_s, ramp)
            ],
        )
    yield (
        "frozen, with a jitter of a digit",
        [
            case
            for psi in (0.5, 1.0, 2.0, 3.0, 3.5, 3.8, 3.85, 3.87, 3.89)
            for case in each(f"{psi:g} psi", f"regulator=jittering-sensor@{psi}psi", hold_s)
        ],
    )
    yield (
        "drifting in the hold",
        [
            case
            for rate in (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
            for case in each(f"{rate:g} psi/s", f"regulator=drifting-sensor:{rate}@8", hold_s + 20)
        ],
    )
    yield (
        "healthy, ramps of 0.05 to 1.4 psi/s",
        [
            case
            for ramp in ("0.05 psi/s", "0.2 psi/s", "0.5 psi/s", "1 psi/s", "1.4 psi/s")
            for case in each(ramp, None, 2 * hold_s, ramp)
        ],
    )
    cameras = {
        "noise 0.02 mm": MarkerSettings(noise_sd_mm=0.02),
        "noise 0.5 mm": MarkerSettings(noise_sd_mm=0.5),
        "occluded a quarter of the time": MarkerSettings(occlusion_hz=1.0, occlusion_s=0.3),
        "occluded half of the time": MarkerSettings(occlusion_hz=3.0, occlusion_s=0.3),
        "a fifth of the frames lost": MarkerSettings(dropout=0.2),
    }
    yield (
        "healthy, bad cameras",
        [
            Case(name, None, seed, 2 * hold_s, cameras=settings)
            for name, settings in cameras.items()
            for seed in range(seeds)
        ],
    )
    yield (
        "healthy, 30 and 960 Hz",
        [
            Case(rate, None, seed, 2 * hold_s, frequency=rate)
            for rate in ("30 Hz", "960 Hz")
            for seed in range(seeds)
        ],
    )
    for rate, name in (("960 Hz", "frozen at 3.88 psi, 960 Hz"), ("30 Hz", _WEAK)):
        fault = "regulator=frozen-sensor@3.88psi"
        yield name, [Case(rate, fault, seed, hold_s, frequency=rate) for seed in range(seeds)]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, help="noises of each case")
    parser.add_argument("--hold", type=float, default=20.0, help="seconds that the pressure is held")
    parser.add_argument("--limit", type=float, default=4.5, help="psi that no case may reach")
    parser.add_argument("--only", default="", help="the kinds whose name has this in it")
    parser.add_argument("--every", action="store_true", help="print every case")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
