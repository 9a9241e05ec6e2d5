"""`labctl report`: runs of a ledger as one HTML page."""

from pathlib import Path

import click

from labctl.cli.ledgers import keep_out_of_ledger, print_notice
from labctl.cli.non_empty_path import NonEmptyPath
from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import emit_json


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option(
    "--out",
    "out_path",
    type=NonEmptyPath(),
    help="File to write; one that is there is replaced.  [default: report-RUN.html]",
)
@ledger_option
@json_option
def report(runs: tuple[str, ...], out_path: Path | None, ledger_folder: Path, as_json: bool) -> None:
    """Write an HTML report of one or several runs.

    RUN is a run's number, or "last". One self-contained file: figures, every attempt, provenance. Several runs are
    put side by side, and compared where they can be.
    """
    from labctl.report.run.page import write_run_page
    from labctl.report.run.reading import read_views

    views = read_views(ledger_folder, runs, print_notice)
    for view in views:
        for name, missing in view.damaged:
            print_notice(f"run {view.run.number}, trial {name}: {missing}; its pressures are left out")
    path = out_path or Path(f"report-{'-'.join(f'{view.run.number:04d}' for view in views)}.html")
    keep_out_of_ledger(path, ledger_folder)
    replaced = path.is_file()
    write_run_page(path, views)
    if as_json:
        emit_json({"page": str(path), "runs": [view.run.number for view in views], "replaced": replaced})
        return
    click.echo(f"{'replaced' if replaced else 'written'}: {path}")
