"""What is for programs of others is marked, in every package, and is there."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = [
    ".".join(path.parent.relative_to(ROOT).parts)
    for top in ("labctl", "sim", "evolve", "protocols")
    for path in sorted((ROOT / top).rglob("__init__.py"))
]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_says_what_of_it_is_public(package):
    names = importlib.import_module(package).__all__
    assert len(set(names)) == len(names)
    for name in names:
        if not hasattr(importlib.import_module(package), name):
            importlib.import_module(f"{package}.{name}")


@pytest.mark.parametrize("top", ["labctl", "sim", "evolve", "protocols"])
def test_a_package_brings_its_types(top):
    assert (ROOT / top / "py.typed").exists()
