"""A command and its ledger: what must stay out of its folder, how what it reports is printed."""

from pathlib import Path

import click

from labctl.errors import BadInput


def keep_out_of_ledger(path: Path, ledger_folder: Path) -> None:
    """Refuse to put what is made for people where a ledger keeps what was measured.

    Raises:
        BadInput: `path` is one of the ledger's own files, or in its folder of raw recordings.
    """
    try:
        place, ledger = path.resolve(), ledger_folder.resolve()
    # Of a link to itself; whoever writes there reports that it cannot be done.
    except (OSError, RuntimeError):
        return
    if place.is_relative_to(ledger / "raw") or (place.parent == ledger and place.name.startswith("ledger.")):
        raise BadInput(
            f"{path}: is where ledger {ledger_folder} keeps what was measured; name another with --out"
        )


def print_notice(text: str) -> None:
    """Print a line for a person on standard error: the `notify` of a ledger."""
    click.echo(f"labctl: {text}", err=True)
