"""`labctl pause`, `labctl resume`, `labctl abort`: words to a run that goes on in another terminal."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import emit_json

if TYPE_CHECKING:
    from labctl.session.inbox import Word


@click.command()
@ledger_option
@json_option
def pause(ledger_folder: Path, as_json: bool) -> None:
    """Let the run that goes on finish its trial, then wait, the rig SAFE, until `labctl resume`."""
    _ask(ledger_folder, "pause", as_json, "the run pauses after its present trial; labctl resume goes on")


@click.command()
@ledger_option
@json_option
def resume(ledger_folder: Path, as_json: bool) -> None:
    """Let a paused run go on."""
    _ask(ledger_folder, "resume", as_json, "the run goes on")


@click.command()
@ledger_option
@json_option
def abort(ledger_folder: Path, as_json: bool) -> None:
    """End the run that goes on: to SAFE at once, the present trial recorded as aborted."""
    _ask(
        ledger_folder,
        "abort",
        as_json,
        "the run was asked to end; it reads SAFE back in its own terminal, and labctl runs shows how it ended",
    )


def _ask(folder: Path, word: "Word", as_json: bool, said: str) -> None:
    """Leave the word, and say what comes of it.

    Raises:
        BadInput: nobody writes to this ledger.
    """
    from labctl.errors import BadInput
    from labctl.ledger.lock import holder_of
    from labctl.session.inbox import ask

    if holder_of(folder) is None:
        raise BadInput(f"{folder}: no run goes on there; labctl runs lists those that were")
    ask(folder, word)
    if as_json:
        emit_json({"ledger": str(folder), "asked": word})
    else:
        click.echo(said)
