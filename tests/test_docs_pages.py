"""What pages of docs/ tell a person to type, typed: page by page, in an empty folder, in the order of the page.

The pages that need the simulator and short searches alone; those of a rig are tried by the tests of its commands.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGES = [
    "how-to/look-at-a-shape.md",
    "how-to/compare-with-a-target.md",
    "how-to/describe-a-sheet.md",
    "how-to/simulate-many-sheets.md",
    "how-to/use-from-python.md",
]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# What a page has just made a person make, in words.
MADE_BY_HAND = {
    "how-to/use-from-python.md": 'from labctl import api\napi.inflate("sphere", ledger="ledger")\n'
}


def blocks(page):
    """The blocks of a page: Python, or commands one a line."""
    for language, text in BLOCK.findall((DOCS / page).read_text(encoding="utf-8")):
        if language == "python":
            yield [sys.executable, "-P", "-c", text]
        elif not language:
            for line in text.splitlines():
                command = line.split("  #")[0].strip()
                if command.startswith("labctl "):
                    yield ["sh", "-c", command.replace("labctl", f"{sys.executable} -P -m labctl", 1)]


@pytest.mark.long
@pytest.mark.real_time
@pytest.mark.parametrize("page", PAGES, ids=lambda page: Path(page).stem)
def test_a_page_can_be_typed(page, tmp_path):
    steps = list(blocks(page))
    assert steps
    if page in MADE_BY_HAND:
        steps.insert(0, [sys.executable, "-P", "-c", MADE_BY_HAND[page]])
    # Commands of a page may need a file that a later block of it makes.
    waiting = []
    for step in steps:
        done = run(step, tmp_path)
        if done.returncode != 0:
            waiting.append(step)
    for step in waiting:
        done = run(step, tmp_path)
        assert done.returncode == 0, f"{step[-1]}\n{done.stderr}"


def run(step, folder):
    return subprocess.run(
        step,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "MPLBACKEND": "agg"},
    )
