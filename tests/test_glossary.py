"""The glossary's names are names of the code."""

import pkgutil
import re
from dataclasses import fields
from pathlib import Path

import pytest

GLOSSARY = Path(__file__).parents[1] / "docs" / "explanation" / "glossary.md"
NAMES = sorted(set(re.findall(r"`((?:labctl|sim|evolve)\.[\w.]+)`", GLOSSARY.read_text())))


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_the_glossary_is_there(name: str) -> None:
    owner, last = name.rsplit(".", 1)
    try:
        pkgutil.resolve_name(name)
    except AttributeError:
        # A dataclass's field without a default is no attribute of the class.
        assert last in {field.name for field in fields(pkgutil.resolve_name(owner))}
