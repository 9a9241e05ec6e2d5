"""The questions to an Alicat whose answers can be mistaken for nothing else, least of all for a data frame."""

from collections.abc import Callable

from labctl.drivers.alicat_layout import is_table_line
from labctl.drivers.alicat_lines import (
    end_of_stream_line,
    is_full_scale_line,
    is_manufacturing_line,
    is_streamed_line,
    is_version_line,
    request_line,
)
from labctl.links.line_resync import Probe, Stream

VERSION, FULL_SCALE, IDENTITY, LAYOUT = "VE", "FPF 6", "??M*", "??D*"

# At 19200 baud: one line takes 0.03 s, the ten of `??M*` 0.2 s, the twenty of `??D*` 0.7 s.
_PATIENCE_S = {VERSION: 0.3, FULL_SCALE: 0.3, IDENTITY: 0.6, LAYOUT: 1.2}


def probe(question: str, unit_id: str, label: str = "") -> Probe:
    """The question as the link asks it; `label` is the unit in which the device names its full scale."""
    tests: dict[str, Callable[[bytes], bool]] = {
        VERSION: lambda line: is_version_line(line, unit_id),
        FULL_SCALE: lambda line: is_full_scale_line(line, unit_id, label),
        IDENTITY: lambda line: is_manufacturing_line(line, unit_id),
        LAYOUT: lambda line: is_table_line(line, unit_id),
    }
    return Probe(
        request_line(unit_id, question),
        tests[question],
        many_lines=question in (IDENTITY, LAYOUT),
        patience_s=_PATIENCE_S[question],
    )


def stream(unit_id: str) -> Stream:
    """How the device streams, and how it is given its unit id back."""
    return Stream(is_streamed_line, end_of_stream_line(unit_id))
