"""Commands that texts name work when they are pasted: nothing is left out, and nothing breaks at a blank."""

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest

from labctl.cli.main import COMMANDS
from labctl.next_command import TAKES, next_command, note_given, noting

ROOT = Path(__file__).parents[1]
NAMED = re.compile(rf"\blabctl ({'|'.join(COMMANDS)})\b")
# Texts that name a command and are no message: the help of options and commands, and what a file calls its format.
HELPED = {"help", "short_help", "epilog"}
FORMATS = {"labctl evolve run", "labctl evolve checkpoint"}
# Messages that name a command and need nothing of this one's.
COMPLETE = {
    ("labctl/session/own_doubles.py", "doubles"),
    ("labctl/cli/log_options.py", "run"),
    ("labctl/ledger/ledger.py", "run"),
    ("labctl/safety/zero.py", "tare"),
    ("labctl/session/run_stop.py", "abort"),
    ("labctl/design_search/search_run.py", "evolve"),
    ("labctl/report/run/page.py", "report"),
    ("labctl/simulation/targets/target_file.py", "compare"),
    ("evolve/search.py", "simulate"),
}


def test_every_command_is_known_with_options_that_it_takes():
    assert set(TAKES) == set(COMMANDS)
    for name, (module, attribute, _) in COMMANDS.items():
        command = getattr(importlib.import_module(module), attribute)
        options = {opt for parameter in command.params for opt in parameter.opts}
        assert set(TAKES[name]) <= options, name


def test_what_this_command_was_given_the_next_one_is_given_too():
    with noting():
        note_given("--rig", Path("mein Rig ü.toml"))
        note_given("--ledger", "other")
        note_given("--speed", 20.0)
        assert shlex.split(next_command("show", 3)) == ["labctl", "show", "3", "--ledger", "other"]
        assert shlex.split(next_command("vent")) == ["labctl", "vent", "--rig", "mein Rig ü.toml"]
        assert shlex.split(next_command("run", "--continue", 3)) == (
            [
                "labctl",
                "run",
                "--continue",
                "3",
                "--rig",
                "mein Rig ü.toml",
                "--ledger",
                "other",
                "--speed",
                "20.0",
            ]
        )
    with noting():
        assert next_command("vent") == "labctl vent"


def test_beyond_a_command_line_a_placeholder_stands_for_the_rig():
    assert next_command("tare") == "labctl tare --rig FILE"
    assert next_command("runs") == "labctl runs"


def test_a_command_that_is_not_known_is_an_error():
    with pytest.raises(KeyError):
        next_command("went")


def test_no_message_names_a_command_by_hand():
    found = set()
    for package in ("labctl", "sim", "evolve", "protocols"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for text in messages(ast.parse(path.read_text(encoding="utf-8"))):
                if text not in FORMATS:
                    found |= {(str(path.relative_to(ROOT)), name) for name in NAMED.findall(text)}
    assert found - COMPLETE == set(), "write it by labctl.next_command, so that it works when it is pasted"


def messages(tree):
    """The strings of a module that are neither docstrings nor help."""
    left_out = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and node.body:
            first = node.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                left_out.add(first.value)
        if isinstance(node, ast.keyword) and node.arg in HELPED:
            left_out |= set(ast.walk(node.value))
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in left_out
    ]
