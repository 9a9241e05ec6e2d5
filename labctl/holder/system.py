"""The holders of rigs on this machine: locked files and sockets in a private folder of the user."""

import os
import signal
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from labctl.errors import BadInput, LabError, NoAnswer, RigUnavailable
from labctl.holder.answering import Answering, listen_at
from labctl.holder.asking import SocketConversation
from labctl.holder.entries import (
    Locked,
    close_all,
    holder_of,
    lock_all,
    locked_files,
    look,
    path_of,
    write_entry,
)
from labctl.holder.folders import candidates, first_private, private_folders
from labctl.holder.interfaces import Answerer, Held, RigHeld
from labctl.holder.records import VERSION, Ask, Entry, Holder

_LOOK_S = 0.02


class SystemHolders:
    """Finds who holds a rig on this machine, and holds one; `places` are the folders, this user's where None."""

    def __init__(self, places: tuple[Path, ...] | None = None) -> None:
        self._places = places

    def hold(
        self,
        holder: Holder,
        addresses: Sequence[str],
        reach: Mapping[str, Any],
        answerer: Answerer | None,
        patience_s: float,
    ) -> "FileHolding":
        """Hold a rig, which takes up to `patience_s` where somebody is just letting go of it.

        Raises:
            RigHeld: somebody else holds it.
            RigUnavailable: somebody does who has not said who they are.
            BadInput: there is no private folder, or nothing can be written there.
        """
        end_s = time.monotonic() + patience_s
        folder = first_private(self._folders(), os.getuid())
        while True:
            found = self.find(addresses)
            try:
                descriptors = None if found else lock_all(folder, addresses)
                if descriptors is not None:
                    entry = Entry(VERSION, holder, tuple(addresses), reach)
                    return FileHolding(folder, descriptors, entry, answerer)
            except OSError as error:
                raise BadInput(
                    f"{folder}: {error.strerror or error}: no other terminal could find this command; remove what is "
                    "in the way there"
                ) from error
            if time.monotonic() >= end_s:
                if found:
                    raise RigHeld(found[0])
                raise RigUnavailable(f"{holder.rig_name} is being opened by another labctl; try again")
            time.sleep(_LOOK_S)

    def find(self, addresses: Sequence[str]) -> tuple[Held, ...]:
        """Who holds a rig that has one of these addresses; never for a rig that this process holds."""
        folders = private_folders(self._folders(), os.getuid())
        return _distinct([path_of(folder, address) for folder in folders for address in addresses])

    def all(self) -> tuple[Held, ...]:
        """Every rig that a process of this user holds; not while this process holds one."""
        folders = private_folders(self._folders(), os.getuid())
        return _distinct([path for folder in folders for path in locked_files(folder)])

    def _folders(self) -> tuple[Path, ...]:
        return candidates(os.environ, os.getuid()) if self._places is None else self._places


class FileHolding:
    """The locked files of a rig, and the thread that answers for it."""

    def __init__(
        self, folder: Path, descriptors: tuple[int, ...], entry: Entry, answerer: Answerer | None
    ) -> None:
        self._descriptors = descriptors
        self._sockets: list[Path] = []
        self._answering: Answering | None = None
        try:
            if answerer is not None:
                path = _socket_of(path_of(folder, entry.addresses[0]))
                listener = listen_at(path)
                self._sockets.append(path)
                self._answering = Answering(listener, answerer)
            write_entry(descriptors, entry)
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Send the last state to who listens, and let go; may be called twice."""
        if self._answering is not None:
            self._answering.finish()
        while self._sockets:
            # Before the lock is given back: the next holder's may be there after that.
            with suppress(OSError):
                self._sockets.pop().unlink()
        close_all(self._descriptors)
        self._descriptors = ()


class ProcessHeld:
    """A rig that another process held when it was looked for."""

    def __init__(self, locked: Locked) -> None:
        self._locked = locked

    @property
    def entry(self) -> Entry:
        """Who, and how the rig is reached."""
        return self._locked.entry

    @property
    def pid(self) -> int:
        """The process, by the kernel's word; 0 where it cannot be seen from here."""
        return self._locked.pid

    def is_held(self) -> bool:
        """Whether the same process holds it still."""
        return holder_of(self._locked.path) == self._locked.pid

    def ask(self, word: Ask, timeout_s: float) -> SocketConversation:
        """Ask; the first state is the answer.

        Raises:
            NoAnswer: it was not taken in time.
        """
        if _has_stopped(self.pid):
            # It cannot answer: every second of waiting is one under pressure.
            raise NoAnswer(f"process {self.entry.holder.pid} has been stopped (SIGSTOP, Ctrl-Z)")
        first = path_of(self._locked.path.parent, self.entry.addresses[0])
        return SocketConversation(_socket_of(first), f"process {self.entry.holder.pid}", word, timeout_s)

    def end(self) -> None:
        """SIGKILL to the process that the kernel says holds the rig's lock: no other can be hit.

        Raises:
            LabError: it is in another container, or another user's.
        """
        if not self.pid:
            raise LabError(
                f"process {self.entry.holder.pid} holds the rig from another container: it cannot be ended from "
                "here; end it there"
            )
        try:
            _kill(self.pid, self._locked.path)
        except PermissionError as error:
            raise LabError(f"process {self.pid} is another user's and cannot be ended from here") from error


def _has_stopped(pid: int) -> bool:
    """Whether the system says so; where it does not tell, waiting for an answer does."""
    try:
        state = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0]
    except (OSError, IndexError):
        return False
    return state in (b"T", b"t")


def _kill(pid: int, path: Path) -> None:
    with suppress(ProcessLookupError):
        if not hasattr(os, "pidfd_open"):
            if holder_of(path) == pid:
                os.kill(pid, signal.SIGKILL)
            return
        process = os.pidfd_open(pid)
        try:
            # Asked once the process is pinned: its number may have become another's since.
            if holder_of(path) == pid:
                signal.pidfd_send_signal(process, signal.SIGKILL)
        finally:
            os.close(process)


def _socket_of(path: Path) -> Path:
    return path.with_suffix(".sock")


def _distinct(paths: Sequence[Path]) -> tuple[Held, ...]:
    """Who holds these files, each once."""
    found: dict[tuple[Path, int, tuple[str, ...]], Held] = {}
    for path in paths:
        locked = look(path)
        if locked is not None:
            found.setdefault((path.parent, locked.pid, locked.entry.addresses), ProcessHeld(locked))
    return tuple(found.values())
