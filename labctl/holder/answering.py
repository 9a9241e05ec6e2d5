"""The holder's side of the wire: a thread that answers at once, and sends its state to whoever watches.

One JSON object a line. Whoever connects sends one `Request`; the answer is a `RigState`, and to "watch", "vent" and
"abort" it is followed by more of them until the holder lets go. Nobody is waited for: to who does not read, nothing
more is sent until they do, and then the latest.
"""

import json
import os
import selectors
import socket
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from labctl.holder.interfaces import Answerer
from labctl.holder.records import Request, read_record
from labctl.plain_json import NotPlain, to_json

_PERIOD_S = 0.05
_MOST_LISTENERS = 32
_LONGEST_REQUEST = 4096
_FINISH_S = 0.5
_UNREAD = 1 << 16


def listen_at(path: Path) -> socket.socket:
    """A listening socket at `path`, in the place of one that a process that is gone has left there."""
    with suppress(FileNotFoundError):
        path.unlink()
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listener.bind(str(path))
        path.chmod(0o600)
        listener.listen(_MOST_LISTENERS)
        listener.setblocking(False)
    except BaseException:
        listener.close()
        raise
    return listener


class Answering:
    """Answers on `listener` for `answerer` until it is finished."""

    def __init__(self, listener: socket.socket, answerer: Answerer) -> None:
        self._listener = listener
        self._answerer = answerer
        self._listeners: dict[socket.socket, _Listener] = {}
        self._selector = selectors.DefaultSelector()
        self._wake_read, self._wake_write = os.pipe()
        self._ending = threading.Event()
        self._selector.register(listener, selectors.EVENT_READ, self._accept)
        self._selector.register(self._wake_read, selectors.EVENT_READ, lambda: None)
        self._thread = threading.Thread(target=self._run, name="answering for the rig's holder", daemon=True)
        self._thread.start()

    def finish(self) -> None:
        """Send the last state and hang up; may be called twice."""
        if not self._ending.is_set():
            self._ending.set()
            # A thread that has ended has closed the pipe.
            with suppress(OSError):
                os.write(self._wake_write, b"x")
            self._thread.join(_FINISH_S)

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                watched = any(listener.stays for listener in self._listeners.values())
                for key, _ in self._selector.select(_PERIOD_S if watched else None):
                    # Whatever one listener does, the others are answered.
                    with suppress(Exception):
                        key.data()
                if watched:
                    with suppress(Exception):
                        self._send_to_all(self._line(ended=False))
            self._send_to_all(self._line(ended=True))
        finally:
            self._hang_up()

    def _hang_up(self) -> None:
        for listener in list(self._listeners.values()):
            listener.socket.close()
        self._listener.close()
        self._selector.close()
        os.close(self._wake_read)
        os.close(self._wake_write)

    def _accept(self) -> None:
        peer, _ = self._listener.accept()
        if len(self._listeners) >= _MOST_LISTENERS:
            peer.close()
            return
        peer.setblocking(False)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD)
        listener = _Listener(peer)
        self._listeners[peer] = listener
        self._selector.register(peer, selectors.EVENT_READ, lambda: self._hear(listener))

    def _hear(self, listener: "_Listener") -> None:
        try:
            request = listener.hear()
        except (OSError, ValueError, NotPlain):
            self._drop(listener)
            return
        if request is None:
            return
        if request.ask in ("vent", "abort"):
            self._answerer.request("vent" if request.ask == "vent" else "abort", request)
        listener.stays = request.ask != "state"
        if not listener.send(self._line(ended=False)) or not listener.stays:
            self._drop(listener)

    def _line(self, *, ended: bool) -> bytes:
        state = replace(self._answerer.state(), ended=ended)
        return json.dumps(to_json(state, lossy=True)).encode() + b"\n"

    def _send_to_all(self, line: bytes) -> None:
        for listener in [each for each in self._listeners.values() if each.stays]:
            if not listener.send(line):
                self._drop(listener)

    def _drop(self, listener: "_Listener") -> None:
        del self._listeners[listener.socket]
        self._selector.unregister(listener.socket)
        listener.socket.close()


class _Listener:
    """Somebody who has connected; `stays` once they are to get every state."""

    def __init__(self, peer: socket.socket) -> None:
        self.socket = peer
        self.stays = False
        self._heard = b""
        self._unsent = b""

    def hear(self) -> Request | None:
        """The request, once it has come whole.

        Raises:
            OSError: they have hung up.
            ValueError, NotPlain: it is no request.
        """
        data = self.socket.recv(_LONGEST_REQUEST)
        if not data:
            raise ConnectionResetError
        if self.stays:
            return None
        self._heard += data
        if len(self._heard) > _LONGEST_REQUEST:
            raise ValueError("longer than a request")
        if not self._heard.endswith(b"\n"):
            return None
        return read_record(Request, json.loads(self._heard))

    def send(self, line: bytes) -> bool:
        """Send a line, or what is left of the last one; False where they have hung up."""
        left = self._unsent or line
        try:
            self._unsent = left[self.socket.send(left) :]
        except BlockingIOError:
            self._unsent = self._unsent and left
        except OSError:
            return False
        return True
