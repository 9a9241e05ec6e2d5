"""`labctl export`: a run in files that other programs read."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.ledgers import keep_out_of_ledger, print_notice
from labctl.cli.non_empty_path import NonEmptyPath
from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import emit_json

if TYPE_CHECKING:
    from labctl.export.run_export import Format

_FORMATS: "tuple[Format, ...]" = ("csv", "parquet", "c3d")


@click.command()
@click.argument("run")
@click.option(
    "--format",
    "kind",
    type=click.Choice(_FORMATS),
    required=True,
    help="Tables as CSV, tables and raw files as Parquet, or a C3D file a trial.",
)
@click.option(
    "--out",
    "out_path",
    type=NonEmptyPath(),
    help="Folder to make; it must not be there yet.  [default: run-RUN-FORMAT]",
)
@ledger_option
@json_option
def export(run: str, kind: "Format", out_path: Path | None, ledger_folder: Path, as_json: bool) -> None:
    """Export a run as CSV, Parquet or C3D files, into a folder of their own.

    RUN is a run's number, or "last".
    """
    from labctl.export.run_export import export_run
    from labctl.ledger.ledger import Ledger

    with Ledger.open(ledger_folder, print_notice) as ledger:
        record = ledger.find(run)
        folder = out_path or Path(f"run-{record.number:04d}-{kind}")
        keep_out_of_ledger(folder, ledger_folder)
        exported = export_run(ledger, record, kind, folder)
    if as_json:
        emit_json(
            {
                "folder": str(exported.folder),
                "files": list(exported.files),
                "left_out": list(exported.left_out),
            }
        )
        return
    for trial in exported.left_out:
        print_notice(trial)
    for name in exported.files:
        click.echo(f"written: {exported.folder / name}")
