"""A run from the command line, started or continued, and its result."""

import tempfile
from contextlib import nullcontext
from pathlib import Path

from labctl.cli.ledgers import print_notice
from labctl.cli.rigs import rig_to_be
from labctl.cli.run.options import SessionOptions
from labctl.cli.run.session import conduct_session, open_session
from labctl.cli.run.text import print_result
from labctl.errors import BadInput
from labctl.ledger.ledger import Ledger
from labctl.session.continuation import prepare_continuation
from labctl.session.measure import FinishedRun
from labctl.session.prepare import PreparedRun
from labctl.session.request import plan


def start_run(prepared: PreparedRun, design_name: str, ledger_folder: Path, options: SessionOptions) -> None:
    """Start a new run; what cannot be run is refused before a ledger is made or doubles are started."""
    plan(prepared.protocol, prepared.request, prepared.design, rig_to_be(options.rig_path, prepared.design))
    with open_session(nullcontext(ledger_folder), options) as session:
        finished = conduct_session(prepared, design_name, options, session, quiet=options.as_json, kept=True)
        session.line.give_way()
        _print_result(finished, options)


def continue_run(name: str, ledger_folder: Path, options: SessionOptions) -> None:
    """Continue the run of this name at its next trial."""
    with Ledger.open(ledger_folder, print_notice) as read:
        run = prepare_continuation(read, name).run
    if run is not None and not run.simulated and options.rig_path is None:
        raise BadInput(f"run {run.number} was measured on a real rig: name it with --rig")
    with (
        open_session(nullcontext(ledger_folder), options) as session,
        tempfile.TemporaryDirectory() as folder,
    ):
        # Another process may have finished it since.
        prepared = prepare_continuation(session.writer, name)
        # The doubles' sheet is the one of the run, whatever became of the design's file.
        design = Path(folder) / "design.toml"
        design.write_text(prepared.design_text, encoding="utf-8")
        finished = conduct_session(prepared, str(design), options, session, quiet=options.as_json, kept=True)
        session.line.give_way()
        _print_result(finished, options)


def _print_result(finished: FinishedRun, options: SessionOptions) -> None:
    print_result(finished.run, finished.summary, finished.trials, finished.safe, options.as_json)
