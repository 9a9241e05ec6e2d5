"""A run from the command line: a new one, or one that goes on, and its result."""

import tempfile
from contextlib import nullcontext
from pathlib import Path

from labctl.cli.ledgers import print_note
from labctl.cli.rigs import rig_to_be
from labctl.cli.run.options import SessionOptions
from labctl.cli.run.session import FinishedRun, measure, open_session
from labctl.cli.run.text import tell_result
from labctl.errors import BadInput
from labctl.ledger.ledger import Ledger
from labctl.session.prepare import PreparedRun
from labctl.session.request import plan
from labctl.session.resume import prepare_again


def begin(prepared: PreparedRun, design_name: str, ledger_folder: Path, options: SessionOptions) -> None:
    """A new run; what cannot be run is refused before a ledger is made or doubles are started."""
    plan(prepared.protocol, prepared.request, prepared.design, rig_to_be(options.rig_path, prepared.design))
    with open_session(nullcontext(ledger_folder), options) as session:
        finished = measure(prepared, design_name, options, session, quiet=options.as_json)
        _print_result(finished, options)


def resume(name: str, ledger_folder: Path, options: SessionOptions) -> None:
    """The run of this name, at its next trial."""
    with Ledger.open(ledger_folder, print_note) as read:
        run = prepare_again(read, name).run
    if run is not None and not run.simulated and options.rig_path is None:
        raise BadInput(f"run {run.number} was measured on a real rig: name it with --rig")
    with (
        open_session(nullcontext(ledger_folder), options) as session,
        tempfile.TemporaryDirectory() as folder,
    ):
        # Another process may have finished it since.
        prepared = prepare_again(session.writer, name)
        # The doubles' sheet is the one of the run, whatever became of the design's file.
        design = Path(folder) / "design.toml"
        design.write_text(prepared.design_text, encoding="utf-8")
        finished = measure(prepared, str(design), options, session, quiet=options.as_json)
        _print_result(finished, options)


def _print_result(finished: FinishedRun, options: SessionOptions) -> None:
    tell_result(finished.run, finished.summary, finished.trials, finished.safe, options.as_json)
