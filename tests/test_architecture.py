"""The map of the house is true: docs/explanation/architecture.md against the tree and the import contract."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/explanation/architecture.md").read_text()
BLOCKS = re.findall(r"^```\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
PACKAGES = ("labctl", "sim", "evolve", "protocols")
# Without code: what ships beside it.
DATA = {"labctl/designs"}


def mapped():
    """Every path of the map, and its description."""
    paths, above = {}, []
    for line in BLOCKS[0].splitlines():
        indent, names, description = re.fullmatch(
            r"( *)((?:[a-z_0-9]+(?:/|\.py)(?:, )?)+) +(.+)", line
        ).groups()
        del above[len(indent) // 2 :]
        for name in names.split(", "):
            paths["/".join([*above, name.rstrip("/")])] = description
        above.append(names.rstrip("/"))
    return paths


def rooms():
    """Every package of the tree, and the modules that stand beside the rooms of labctl."""
    packages = {
        file.parent.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for file in (ROOT / package).rglob("__init__.py")
    }
    modules = {
        f"labctl/{file.name}" for file in (ROOT / "labctl").glob("*.py") if not file.name.startswith("__")
    }
    return packages, modules


def test_every_room_of_the_tree_is_on_the_map_and_no_other():
    packages, modules = rooms()
    beside = {"tests", "fixtures", "bench", "docs", "examples"}
    assert set(mapped()) == packages | modules | DATA | beside
    assert all((ROOT / path).exists() for path in mapped())


def test_the_import_contract_orders_every_room_as_the_page_has_it():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = (each["layers"] for each in contracts if each["type"] == "layers")
    ordered = [[name.strip().removeprefix("labctl.") for name in layer.split("|")] for layer in layers]
    assert [line.replace(".py", "").split(", ") for line in BLOCKS[1].splitlines()] == ordered

    packages, modules = rooms()
    top = {path for path in packages if path.count("/") == (1 if path.startswith("labctl") else 0)}
    expected = {path.removeprefix("labctl/").removesuffix(".py") for path in (top | modules) - {"labctl"}}
    assert {name for layer in ordered for name in layer} == expected
