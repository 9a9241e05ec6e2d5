"""The options that several commands have, worded once."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from labctl.cli.non_empty_path import NonEmptyPath
from labctl.next_command import note_given


def _noted(ctx: click.Context, option: click.Parameter, path: Path | None) -> Path | None:
    """Note what was typed, for the commands to type next; the environment's is theirs anyway."""
    if option.name is not None and ctx.get_parameter_source(option.name) is ParameterSource.COMMANDLINE:
        note_given(option.opts[0], path)
    return path


def rig_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --rig option."""
    return click.option(
        "--rig",
        "rig_path",
        type=NonEmptyPath(),
        callback=_noted,
        help="The rig's configuration, rig.toml. Without it: doubles, started for this command.",
    )(command)


def held_rig_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --rig option of commands that reach those in other terminals."""
    return click.option(
        "--rig",
        "rig_path",
        type=NonEmptyPath(),
        callback=_noted,
        help="The rig's configuration, rig.toml. Without it: what commands of yours hold.",
    )(command)


def design_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --design option."""
    return click.option(
        "--design",
        "design_name",
        default="known",
        show_default=True,
        help="A shipped design's name, or a design file.",
    )(command)


def json_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --json option."""
    return click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")(
        command
    )


def ledger_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --ledger option: `ledger_folder`."""
    return click.option(
        "--ledger",
        "ledger_folder",
        type=NonEmptyPath(),
        default=Path("ledger"),
        show_default=True,
        envvar="LABCTL_LEDGER",
        show_envvar=True,
        callback=_noted,
        help="The ledger's folder.",
    )(command)
