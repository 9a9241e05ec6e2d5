"""What is settled before a rig is opened: the protocol, the complete request, the design."""

from dataclasses import dataclass

from labctl.config.design import Design
from labctl.config.load import design_text, load_design
from labctl.ledger.records import RunRecord, RunRequest
from labctl.session.contract import Protocol
from labctl.session.request import RunOptions, complete


@dataclass(frozen=True)
class PreparedRun:
    """A request with its protocol and design; `run` is the record of a run that is continued, None for a new one."""

    protocol: Protocol
    request: RunRequest
    design: Design
    design_text: str
    run: RunRecord | None = None


def prepare(protocol: Protocol, options: RunOptions, design_name: str) -> PreparedRun:
    """A new run.

    Raises:
        BadInput: no such design, or the protocol does not take what the options give.
    """
    design = load_design(design_name)
    return PreparedRun(protocol, complete(protocol, options, design), design, design_text(design_name))
