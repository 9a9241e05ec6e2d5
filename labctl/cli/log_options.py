"""`--log` and `--verbose`, which every command has."""

import os

import click

from labctl.nonblocking_output import NonBlockingOutput


def add_log_options(command: click.Command) -> None:
    """Give a command, or each of a group's, the options of logging; may be called twice."""
    if isinstance(command, click.Group):
        for each in command.commands.values():
            add_log_options(each)
        return
    if any(parameter.name == "log_text" for parameter in command.params):
        return
    command.params += [
        click.Option(
            ["--log", "log_text"],
            metavar="wire|all[=FILE]",
            envvar="LABCTL_LOG",
            show_envvar=True,
            expose_value=False,
            callback=_start_log,
            help="Append every byte sent and received to a file (all: the rest too).  [default file: "
            "labctl-wire.log, labctl.log]",
        ),
        click.Option(
            ["--verbose"],
            is_flag=True,
            expose_value=False,
            callback=_start_terminal,
            help="Write on standard error what is done with the instruments.",
        ),
    ]


def _start_log(context: click.Context, _: click.Parameter, text: str | None) -> None:
    if not text or context.resilient_parsing:
        return
    from labctl.logs.files import ENVIRONMENT, LogChoice, logged_to_file

    choice = LogChoice.parse(text)
    context.with_resource(logged_to_file(choice, NonBlockingOutput(_write_notice).write))
    # For the guard, which opens the same ports when this program dies.
    os.environ[ENVIRONMENT] = choice.for_environment()


def _start_terminal(context: click.Context, _: click.Parameter, verbose: bool) -> None:
    if not verbose or context.resilient_parsing:
        return
    from labctl.logs.files import logged_to_terminal

    context.with_resource(logged_to_terminal())


def _write_notice(text: str) -> None:
    click.echo(f"labctl: {text}", err=True)
