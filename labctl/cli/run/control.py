"""`labctl pause`, `labctl resume`, `labctl abort`: requests to a run that another terminal shows."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import emit_json

if TYPE_CHECKING:
    from labctl.session.control_file import ControlRequest


@click.command()
@ledger_option
@json_option
def pause(ledger_folder: Path, as_json: bool) -> None:
    """Pause the running protocol after this trial.

    The rig stays SAFE until `labctl resume`.
    """
    _request(ledger_folder, "pause", as_json, "the run pauses after this trial; labctl resume resumes it")


@click.command()
@ledger_option
@json_option
def resume(ledger_folder: Path, as_json: bool) -> None:
    """Resume a paused protocol."""
    _request(ledger_folder, "resume", as_json, "the run resumes")


@click.command()
@ledger_option
@json_option
def abort(ledger_folder: Path, as_json: bool) -> None:
    """Abort the running protocol and vent.

    The present trial is recorded as aborted.
    """
    _request(
        ledger_folder,
        "abort",
        as_json,
        "abort requested; its own terminal shows the run vent and read SAFE back, labctl runs how it ended",
    )


def _request(folder: Path, request: "ControlRequest", as_json: bool, reply: str) -> None:
    """Write the request, and print `reply`.

    Raises:
        BadInput: nobody writes to this ledger.
    """
    from labctl.errors import BadInput
    from labctl.ledger.lock import holder_of
    from labctl.session.control_file import write_request

    if holder_of(folder) is None:
        raise BadInput(f"{folder}: no protocol is running there; labctl runs lists what has run")
    write_request(folder, request)
    if as_json:
        emit_json({"ledger": str(folder), "asked": request})
    else:
        click.echo(reply)
