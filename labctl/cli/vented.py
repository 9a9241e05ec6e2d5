"""What became of rigs that were vented, as `labctl vent` and `labctl abort` print it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.output import SIMULATED, banner, emit_json, unit_json, unit_line

if TYPE_CHECKING:
    from labctl.config.rig import RigConfig
    from labctl.holder.interfaces import Held
    from labctl.safety.safe_state import SafeReport


@dataclass(frozen=True)
class VentedRig:
    """What became of one held rig; `by_holder` where its own process read it back."""

    held: "Held"
    report: "SafeReport"
    by_holder: bool

    @property
    def name(self) -> str:
        """The rig's."""
        return self.held.entry.holder.rig_name

    @property
    def simulated(self) -> bool:
        """Whether doubles answer."""
        return self.held.entry.holder.simulated

    def print_unit(self) -> None:
        """Nothing: its configuration is its holder's."""

    def print_by(self) -> None:
        """By whom it was held, and vented."""
        by = "that process" if self.by_holder else "this one, in its place"
        click.echo(f"held by {self.held.entry.holder.describe()}; vented and read back by {by}")

    def for_machines(self) -> dict[str, Any]:
        """The JSON of it."""
        holder = self.held.entry.holder
        return {
            "simulated": holder.simulated,
            **_report_for_machines(self.report),
            "rig": holder.rig_name,
            "held_by": {"pid": holder.pid, "command": holder.command, "since": holder.since},
            "read_back_by_holder": self.by_holder,
        }


@dataclass(frozen=True)
class FreeRig:
    """What became of a rig that nobody held."""

    config: "RigConfig"
    report: "SafeReport"

    @property
    def name(self) -> str:
        """The rig's."""
        return self.config.name

    @property
    def simulated(self) -> bool:
        """Whether doubles answer."""
        return self.config.simulated

    def print_unit(self) -> None:
        """What vouches for its pressure unit."""
        unit_line(self.config.regulator)

    def print_by(self) -> None:
        """Nothing: this command did it."""

    def for_machines(self) -> dict[str, Any]:
        """The JSON of it."""
        return {
            "simulated": self.simulated,
            **unit_json(self.config.regulator),
            **_report_for_machines(self.report),
            "rig": self.name,
        }


def print_vented(vented: Sequence[VentedRig | FreeRig], *, as_json: bool) -> int:
    """Print what was read back of each; returns the exit code: 0 where all are SAFE."""
    safe = all(rig.report.safe for rig in vented)
    if as_json:
        rigs = [rig.for_machines() for rig in vented]
        emit_json(rigs[0] if len(rigs) == 1 else {"safe": safe, "rigs": rigs})
        return 0 if safe else 1
    banner(all(rig.simulated for rig in vented))
    for rig in vented:
        rig.print_unit()
        simulated = f" ({SIMULATED})" if rig.simulated and len(vented) > 1 else ""
        click.echo(f"{rig.name}{simulated}: {rig.report.describe()}")
        rig.print_by()
    return 0 if safe else 1


def _report_for_machines(report: "SafeReport") -> dict[str, Any]:
    """What was read back on the way to SAFE."""
    return {
        "safe": report.safe,
        "pressure_psi": report.pressure_psi,
        "setpoint_psi": report.setpoint_psi,
        "vented_by": report.vented_by,
        "channels_on": None if report.channels_on is None else sorted(report.channels_on),
        "problems": report.problems,
    }
