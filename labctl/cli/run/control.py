"""`labctl pause`, `labctl resume`, `labctl abort`: requests to a run that another terminal shows."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from labctl.cli.options import held_rig_option, json_option, ledger_option
from labctl.cli.output import ProgressLine, emit_json
from labctl.errors import BadInput
from labctl.next_command import next_command

if TYPE_CHECKING:
    from labctl.session.control_file import ControlRequest


@click.command()
@ledger_option
@json_option
def pause(ledger_folder: Path, as_json: bool) -> None:
    """Pause the running protocol after this trial.

    The rig stays SAFE until `labctl resume`.
    """
    _request(
        ledger_folder,
        "pause",
        as_json,
        f"the run pauses after this trial; {next_command('resume')} resumes it",
    )


@click.command()
@ledger_option
@json_option
def resume(ledger_folder: Path, as_json: bool) -> None:
    """Resume a paused protocol."""
    _request(ledger_folder, "resume", as_json, "the run resumes")


@click.command()
@held_rig_option
@ledger_option
@json_option
@click.pass_context
def abort(ctx: click.Context, rig_path: Path | None, ledger_folder: Path, as_json: bool) -> int:
    """Abort the running command and vent: a protocol, inflate, whatever holds the rig, in whatever folder.

    The present trial is recorded as aborted. What is aborted: the command that holds the rig of --rig; else the run
    that writes to the ledger; else the only command of yours that holds a rig. One that does not answer within a
    second is ended, and the rig is vented from here. Exit code 0: SAFE was read back.
    """
    from labctl.cli.held import held_by_file, held_rigs, one_held_rig, vent_rigs
    from labctl.cli.vented import print_vented
    from labctl.ledger.lock import holder_of

    given = ctx.get_parameter_source("ledger_folder") is not ParameterSource.DEFAULT
    if given and rig_path is not None:
        raise BadInput(
            "--rig and --ledger: give one of them, the rig of the command or the ledger of the run"
        )
    writer = None if rig_path is not None else holder_of(ledger_folder)
    found = (rig_path is not None and held_by_file(rig_path)) or held_rigs(rig_path)
    if writer is not None or given:
        found = tuple(held for held in found if writer is not None and held.entry.holder.pid == writer.pid)
        if not found:
            # Another user's, or one that has opened no rig yet.
            reply = "abort requested; its own terminal shows the run vent and read SAFE back"
            _request(ledger_folder, "abort", as_json, f"{reply}, {next_command('runs')} how it ended")
            return 0
    held = one_held_rig(found, rig_path, f"name one with --rig; {next_command('vent')} vents them all")
    with ProgressLine(quiet=True) as line:
        vented = vent_rigs([held], "abort", line.notify)
    return print_vented(vented, as_json=as_json)


def _request(folder: Path, request: "ControlRequest", as_json: bool, reply: str) -> None:
    """Write the request, and print `reply`.

    Raises:
        BadInput: nobody writes to this ledger.
    """
    from labctl.ledger.lock import holder_of
    from labctl.session.control_file import write_request

    if holder_of(folder) is None:
        raise BadInput(f"{folder}: no protocol is running there")
    write_request(folder, request)
    if as_json:
        emit_json({"ledger": str(folder), "asked": request})
    else:
        click.echo(reply)
