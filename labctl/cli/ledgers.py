"""Which ledger a command works on, and how the ledger speaks to a person."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click


def ledger_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --ledger option: `ledger_folder`."""
    return click.option(
        "--ledger",
        "ledger_folder",
        type=click.Path(path_type=Path),
        default=Path("ledger"),
        show_default=True,
        envvar="LABCTL_LEDGER",
        show_envvar=True,
        help="The ledger's folder.",
    )(command)


def tell(text: str) -> None:
    """Say on standard error what the ledger has to say."""
    click.echo(f"labctl: {text}", err=True)
