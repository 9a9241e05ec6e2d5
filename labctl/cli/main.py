"""The `labctl` group: finds commands by name without importing them, and turns errors into exit codes."""

import importlib
import json
import sys
import traceback
from collections.abc import Sequence
from typing import Any

import click

from labctl import __version__
from labctl.errors import LabError

# Name -> (module, attribute, one line of help): `labctl --help` must not import what the commands need.
COMMANDS = {
    "inflate": ("labctl.cli.inflate", "inflate", "Stiffen a pattern, inflate, measure, compare, vent."),
    "vent": ("labctl.cli.vent", "vent", "Take the rig to SAFE and read it back."),
    "status": ("labctl.cli.status", "status", "What the instruments read now; changes nothing."),
    "doctor": ("labctl.cli.doctor", "doctor", "Who is connected and which protections this rig really has."),
    "simulate": ("labctl.cli.simulate", "simulate", "The shape of a pattern or of a voxel file."),
    "compare": ("labctl.cli.compare", "compare", "Measured heights against a pattern's simulation."),
    "doubles": ("labctl.cli.doubles", "doubles", "Byte-level doubles of the instruments."),
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
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands from the table above."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, _, text) in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="labctl")
def labctl() -> None:
    """Run a soft-robotics laboratory: variable-stiffness sheets, inflated, measured and simulated.

    Without --rig a command starts byte-level doubles of the instruments and says SIMULATED RIG.
    """


def run(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code: 0, 1 for a failure at run time, 2 for bad input."""
    as_json = "--json" in arguments
    try:
        result: Any = labctl.main(args=list(arguments), prog_name="labctl", standalone_mode=False)
        return result if isinstance(result, int) else 0
    except click.ClickException as error:
        _report(error.format_message(), as_json)
        if isinstance(error, click.UsageError) and error.ctx is not None and not as_json:
            click.echo(f"Try '{error.ctx.command_path} --help'.", err=True)
        return 2
    except click.Abort:
        _report("stopped before anything was opened", as_json)
        return 130
    except LabError as error:
        _report(_with_cause(error), as_json)
        return error.exit_code
    except BrokenPipeError:
        # Whoever read the output is gone; the rig was closed by its own `with` block.
        sys.stderr.close()
        return 1
    except Exception as error:
        traceback.print_exc()
        _report(f"labctl itself failed ({error!r}); please report it with the lines above", as_json)
        return 1


def _with_cause(error: LabError) -> str:
    cause = error.__cause__
    return (
        f"{error} (after: {cause})"
        if isinstance(cause, LabError) and str(cause) not in str(error)
        else str(error)
    )


def _report(message: str, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps({"error": message}))
    click.echo(f"labctl: {message}", err=True)
