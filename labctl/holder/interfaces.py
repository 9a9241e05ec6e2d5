"""What the laboratory asks of whatever finds the holders of rigs: this machine's folder and sockets, or a test's."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol

from labctl.errors import RigUnavailable
from labctl.holder.records import Ask, Entry, Holder, Request, RigState
from labctl.next_command import next_command


class Answerer(Protocol):
    """Answers for a holder, on any thread, at once and without waiting for anybody."""

    def state(self) -> RigState:
        """The latest of everything."""
        ...

    def request(self, word: Literal["vent", "abort"], request: Request) -> None:
        """Begin to do what is asked; what becomes of it stands in the state."""
        ...


class Holding(Protocol):
    """A rig that is held by this process, until it is released or the process ends."""

    def release(self) -> None:
        """Let go of the rig; may be called twice."""
        ...


class Conversation(Protocol):
    """The states that a holder sends to somebody who asked."""

    def next_state(self, timeout_s: float) -> RigState | None:
        """The next state; None when the holder has let go or is gone.

        Raises:
            NoAnswer: none came in time.
        """
        ...

    def close(self) -> None:
        """Listen no longer; may be called twice."""
        ...


class Held(Protocol):
    """A rig that somebody held when it was looked for."""

    @property
    def entry(self) -> Entry:
        """Who, and how the rig is reached."""
        ...

    def is_held(self) -> bool:
        """Whether the same process holds it still."""
        ...

    def ask(self, word: Ask, timeout_s: float) -> Conversation:
        """Ask; the first state is the answer.

        Raises:
            NoAnswer: it was not taken in time.
        """
        ...

    def end(self) -> None:
        """End the process that holds the rig, whatever it does.

        Raises:
            LabError: it cannot be ended from here; the message says why.
        """
        ...


class Holders(Protocol):
    """Finds who holds a rig, and holds one."""

    def hold(
        self,
        holder: Holder,
        addresses: Sequence[str],
        reach: Mapping[str, Any],
        answerer: Answerer | None,
        patience_s: float,
    ) -> Holding:
        """Hold a rig, which takes up to `patience_s` where somebody is just letting go of it.

        Raises:
            RigHeld: somebody else holds it.
            BadInput: nothing can be held on this machine; the message says why.
        """
        ...

    def find(self, addresses: Sequence[str]) -> "tuple[Held, ...]":
        """Who holds a rig that has one of these addresses."""
        ...

    def all(self) -> "tuple[Held, ...]":
        """Every rig that a process of this user holds."""
        ...


class RigHeld(RigUnavailable):
    """Somebody else holds the rig."""

    def __init__(self, held: Held) -> None:
        holder = held.entry.holder
        super().__init__(
            f"{holder.rig_name} is held by {holder.describe()}. Nothing was touched. {next_command('watch')} shows "
            f"what it does, {next_command('vent')} ends that and takes the rig to SAFE, also where that process has "
            "stopped"
        )
        self.held = held
