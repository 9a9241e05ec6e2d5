"""Write docs/reference/wire-faults.md: what comes of every driver, wire fault and verb (`make wire-table`)."""

import logging
import sys
from pathlib import Path

from wire_matrix import CALLS, in_words, outcomes_of, tables

PAGE = Path(__file__).parents[1] / "docs/reference/wire-faults.md"
MARK = "<!-- From here on written by `make wire-table`. -->\n"


def main() -> None:
    """Run the matrix and write its tables behind the page's own words."""
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    head, mark, _ = PAGE.read_text().partition(MARK)
    if not mark:
        sys.exit(f"{PAGE} has no line {MARK.strip()!r}: put it back, the tables follow it")
    PAGE.write_text(head + mark + "\n" + tables(lambda cell: in_words(outcomes_of(cell))))
    print(f"{PAGE}: written, {CALLS} calls a cell")


if __name__ == "__main__":
    main()
