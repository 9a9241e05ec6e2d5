"""Asking a holder over its socket: a request, and the states that come back."""

import json
import os
import select
import socket
import time
from contextlib import suppress
from pathlib import Path

from labctl.errors import NoAnswer
from labctl.holder.records import VERSION, Ask, Request, RigState, read_record
from labctl.plain_json import NotPlain, to_json
from labctl.this_process import user_name

_CHUNK = 65536


class SocketConversation:
    """A connection to a holder's socket on which one thing was asked.

    Raises:
        NoAnswer: the request was not taken within `timeout_s`: nobody listens there, or who does has stopped.
    """

    def __init__(self, path: Path, who: str, ask: Ask, timeout_s: float) -> None:
        self._who = who
        self._held = b""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        request = json.dumps(to_json(Request(VERSION, ask, os.getpid(), user_name()))).encode()
        try:
            self._socket.settimeout(timeout_s)
            self._socket.connect(str(path))
            self._socket.sendall(request + b"\n")
        except OSError as error:
            self._socket.close()
            raise NoAnswer(f"{who} took no request ({error.strerror or error})") from error

    def next_state(self, timeout_s: float) -> RigState | None:
        """The newest state that has come, or the next; None when the holder has let go or is gone.

        Raises:
            NoAnswer: none came in time, or what came is none.
        """
        end_s = time.monotonic() + timeout_s
        while b"\n" not in self._held:
            ready, _, _ = select.select([self._socket], [], [], max(0.0, end_s - time.monotonic()))
            if not ready:
                raise NoAnswer(f"{self._who} has not answered for {timeout_s:g} s")
            if not self._receive():
                return None
        # Who was slow to read gets what is true now; the last state is kept for the end.
        while select.select([self._socket], [], [], 0)[0] and self._receive():
            pass
        *lines, self._held = self._held.split(b"\n")
        try:
            state: RigState = read_record(RigState, json.loads(lines[-1]))
        except (ValueError, NotPlain) as error:
            raise NoAnswer(f"{self._who} answers, and not as this labctl understands: {error}") from error
        return state

    def close(self) -> None:
        """Hang up; may be called twice."""
        self._socket.close()

    def _receive(self) -> bool:
        with suppress(ConnectionError):
            data = self._socket.recv(_CHUNK)
            self._held += data
            return bool(data)
        return False
