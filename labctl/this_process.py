"""What this process is called, for people who meet it from another terminal: its user and its command line."""

import getpass
import os
import shlex
import sys
from contextlib import suppress
from pathlib import Path

_MOST_SHOWN = 200


def command_line() -> str:
    """The command that this process was started by, on one line without control characters; its beginning only."""
    program = Path(sys.argv[0])
    # python -m labctl
    name = program.parent.name if program.name == "__main__.py" else program.name
    text = shlex.join([name, *sys.argv[1:]])
    command = "".join(letter if letter.isprintable() else "?" for letter in text)
    return f"{command[:_MOST_SHOWN]} ..." if len(command) > _MOST_SHOWN else command


def user_name() -> str:
    """The user's name; the number where the system has none."""
    # getuser raises what its sources raise, which differs between versions of Python.
    with suppress(OSError, KeyError, ImportError):
        return getpass.getuser()
    return str(os.getuid())
