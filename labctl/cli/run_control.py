"""`labctl pause`, `labctl resume`, `labctl abort`: words to a run that goes on in another terminal."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.ledgers import ledger_option

if TYPE_CHECKING:
    from labctl.session.inbox import Word


@click.command()
@ledger_option
def pause(ledger_folder: Path) -> None:
    """Let the run that goes on finish its trial, then wait, the rig SAFE, until `labctl resume`."""
    _ask(ledger_folder, "pause")
    click.echo("the run pauses after its present trial; labctl resume goes on")


@click.command()
@ledger_option
def resume(ledger_folder: Path) -> None:
    """Let a paused run go on."""
    _ask(ledger_folder, "resume")
    click.echo("the run goes on")


@click.command()
@ledger_option
def abort(ledger_folder: Path) -> None:
    """End the run that goes on: to SAFE at once, the present trial recorded as aborted."""
    _ask(ledger_folder, "abort")
    click.echo(
        "the run was asked to end; it reads SAFE back in its own terminal, and labctl runs shows how it ended"
    )


def _ask(folder: Path, word: "Word") -> None:
    """Leave the word.

    Raises:
        BadInput: nobody writes to this ledger.
    """
    from labctl.errors import BadInput
    from labctl.ledger.lock import holder_of
    from labctl.session.inbox import ask

    if holder_of(folder) is None:
        raise BadInput(f"{folder}: no run goes on there; labctl runs lists those that were")
    ask(folder, word)
