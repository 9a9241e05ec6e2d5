"""Commands that a person is told to type next, complete: with the rig, ledger and speed that this one was given.

Texts name them by `next_command`, wherever they are made: a command that is pasted from a message works. The command
line notes what it was given (`noting`, `note_given`); beyond it, in a script of somebody's own, a placeholder stands
for the rig.
"""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

# Which of --rig, --ledger and --speed each command takes, of those that messages name.
TAKES = {
    "inflate": ("--rig",),
    "run": ("--rig", "--ledger", "--speed"),
    "pause": ("--ledger",),
    "resume": ("--ledger",),
    "abort": (),
    "runs": ("--ledger",),
    "show": ("--ledger",),
    "verify": ("--ledger",),
    "report": ("--ledger",),
    "export": ("--ledger",),
    "watch": ("--rig",),
    "vent": ("--rig",),
    "tare": ("--rig",),
    "status": ("--rig",),
    "doctor": ("--rig",),
    "simulate": (),
    "evolve": (),
    "compare": (),
    "designs": (),
    "doubles": (),
}
_PLACEHOLDER = " --rig FILE"

# By threads of its own too: the schedulers start them in the context of whoever starts them.
_given: ContextVar[dict[str, str] | None] = ContextVar("given", default=None)


@contextmanager
def noting() -> Iterator[None]:
    """A command line runs inside: what `note_given` says counts until it ends."""
    before = _given.set({})
    try:
        yield
    finally:
        _given.reset(before)


def note_given(option: str, value: object) -> None:
    """The running command line was given this option that others need too; nothing beyond a command line."""
    given = _given.get()
    if given is not None:
        given[option] = str(value)


def next_command(name: str, *words: object) -> str:
    """A command to type next, quoted for a shell, with the --rig and --ledger that this one was given.

    Raises:
        KeyError: no command of labctl that messages may name.
    """
    takes, given = TAKES[name], _given.get()
    parts = ["labctl", name, *map(str, words)]
    for option in takes:
        if given is not None and option in given:
            parts += [option, given[option]]
    text = shlex.join(parts)
    return text + _PLACEHOLDER if given is None and "--rig" in takes and name != "run" else text
