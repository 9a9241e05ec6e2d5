"""The `labctl` group: finds commands by name without importing them, and turns errors into exit codes."""

import importlib
import json
import os
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl import __version__
from labctl.cli.log_options import add_log_options
from labctl.cli.outcome import Outcome
from labctl.cli.output import SIMULATED
from labctl.errors import LabError
from labctl.next_command import noting
from labctl.shadowed import shadowed

if TYPE_CHECKING:
    from labctl.rig.platform import Platform

# Name -> (module, attribute, one line of help): `labctl --help` must not import what the commands need.
COMMANDS = {
    "inflate": (
        "labctl.cli.inflate",
        "inflate",
        "Jam a pattern, inflate the sheet, measure it, compare with the simulation, vent.",
    ),
    "run": (
        "labctl.cli.run.command",
        "run",
        "Run a protocol (five-trial, relaxation, calibration, ...) and record it in the ledger.",
    ),
    "pause": ("labctl.cli.run.control", "pause", "Pause the running protocol after this trial."),
    "resume": ("labctl.cli.run.control", "resume", "Resume a paused protocol."),
    "abort": ("labctl.cli.run.control", "abort", "Abort the running protocol and vent."),
    "runs": ("labctl.cli.runs", "runs", "List the runs in the ledger and the state of each."),
    "show": ("labctl.cli.show", "show", "Show everything about a run: trials, numbers, events, provenance."),
    "verify": ("labctl.cli.verify", "verify", "Compute every number of a run again from its raw recordings."),
    "report": ("labctl.cli.report", "report", "Write an HTML report of one or several runs."),
    "export": ("labctl.cli.export", "export", "Export a run as CSV, Parquet or C3D files."),
    "watch": ("labctl.cli.watch", "watch", "Follow what a command in another terminal does with its rig."),
    "vent": ("labctl.cli.vent", "vent", "Take the rig to SAFE and read it back."),
    "tare": ("labctl.cli.tare", "tare", "Tare the gauge of a vented rig, read it back, record it."),
    "status": ("labctl.cli.status", "status", "Show what the instruments read now; writes nothing to them."),
    "doctor": (
        "labctl.cli.doctor",
        "doctor",
        "Check which instruments answer and which protections the rig has.",
    ),
    "simulate": ("labctl.cli.simulate", "simulate", "Simulate the shape of a pattern or of a voxel file."),
    "evolve": ("labctl.cli.evolve.command", "evolve", "Search for fiber layouts that take several shapes."),
    "compare": (
        "labctl.cli.compare",
        "compare",
        "Compare measured heights with the simulation of a pattern.",
    ),
    "designs": (
        "labctl.cli.designs",
        "designs",
        "List the designs that ship with labctl, or print the file of one.",
    ),
    "doubles": (
        "labctl.cli.doubles",
        "doubles",
        "Serve simulated instruments (byte-level doubles) to any client.",
    ),
}


class LazyGroup(click.Group):
    """A group whose commands are imported when they run."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands in the order in which a laboratory meets them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command."""
        if cmd_name not in COMMANDS:
            return None
        module, attribute, _ = COMMANDS[cmd_name]
        command: click.Command = getattr(importlib.import_module(module), attribute)
        add_log_options(command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table above."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, _, text) in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="labctl")
def labctl() -> None:
    """Run a soft-robotics laboratory: variable-stiffness sheets, inflated, measured and simulated.

    Without --rig a command starts byte-level doubles of the instruments and prints SIMULATED RIG.
    """


def run(arguments: Sequence[str], platform: "Platform | None" = None) -> int:
    """Run a command line and return its exit code: 0, 1 for a failure at run time, 2 for bad input.

    `platform` is what rigs are opened on; this machine where it is None.
    """
    with noting():
        return _run(arguments, platform)


def _run(arguments: Sequence[str], platform: "Platform | None") -> int:
    _open_missing_streams()
    as_json = "--json" in arguments
    outcome = Outcome(platform)

    def fail(code: int, message: str) -> int:
        with suppress(OSError):
            _report(message, outcome, as_json)
        return code

    try:
        result: Any = labctl.main(
            args=list(arguments), prog_name="labctl", standalone_mode=False, obj=outcome
        )
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except click.ClickException as error:
        hint = ""
        if isinstance(error, click.UsageError) and error.ctx is not None:
            hint = f". Try '{error.ctx.command_path} --help'"
        return fail(2, error.format_message().rstrip(".") + hint)
    except click.Abort:
        return fail(130, "stopped before anything was opened")
    except LabError as error:
        return fail(error.exit_code, _with_cause(error))
    except OSError as error:
        # Whoever read the output is gone, or the disk is full; the rig was closed by its own `with` block.
        leave_streams()
        return fail(1, f"the output could not be written ({error.strerror or error})")
    except Exception as error:
        if (why := shadowed()) is not None:
            return fail(2, why)
        traceback.print_exc()
        return fail(1, f"labctl itself failed ({error!r}); please report it with the lines above")


def _with_cause(error: LabError) -> str:
    cause = error.__cause__
    if isinstance(cause, LabError) and str(cause) not in str(error):
        return f"{error} (after: {cause})"
    return str(error)


def _report(message: str, outcome: Outcome, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps({"error": message, **outcome.for_machines()}))
    lines = [f"labctl: {message}"]
    if outcome.report is not None and outcome.report.describe() not in message:
        lines.append(f"labctl: {outcome.report.describe()}")
    if outcome.simulated:
        lines.append(f"labctl: {SIMULATED}")
    click.echo("\n".join(lines), err=True)


def _open_missing_streams() -> None:
    """A shell's `2>&-` leaves no stream at all; what would be written there goes nowhere."""
    if sys.stdout is None:
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115 - for the whole life of the process
    if sys.stderr is None:
        sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115 - likewise


def leave_streams() -> None:
    """Keep the interpreter's last flush from failing on a stream that already has."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
