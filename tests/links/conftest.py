"""Peers for the links: a script of what the other end expects to hear and then says."""

import os
import select
import socket
import threading
import time
import tty
from dataclasses import dataclass

import pytest

PATIENCE_S = 5.0


@dataclass(frozen=True)
class Expect:
    """Hear exactly these bytes."""

    data: bytes


@dataclass(frozen=True)
class Say:
    """Send these bytes, after a while."""

    data: bytes
    after_s: float = 0.0


@dataclass(frozen=True)
class HangUp:
    """Close this end."""


class Peer:
    """Plays a script at a file descriptor; whatever it hears beyond the script is a fault."""

    def __init__(self, fd, script):
        self.fd = fd
        self.faults = []
        self._script = list(script)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()

    def finish(self):
        self._over.set()
        self._thread.join(PATIENCE_S)
        self.hang_up()
        assert not self.faults
        assert not self._script, f"left over: {self._script}"

    def hang_up(self):
        if self.fd is not None:
            os.close(self.fd)
            self.fd = None

    def _play(self):
        while self._script and not self.faults:
            step = self._script[0]
            if isinstance(step, Expect):
                heard = self._hear(len(step.data))
                if heard != step.data:
                    self.faults.append(f"expected {step.data!r}, heard {heard!r}")
            elif isinstance(step, Say):
                time.sleep(step.after_s)
                os.write(self.fd, step.data)
            else:
                self.hang_up()
            self._script.pop(0)
        while not self._over.wait(0.005):
            pass
        if self.fd is not None and select.select([self.fd], [], [], 0)[0]:
            try:
                more = os.read(self.fd, 4096)
            except OSError:  # the terminal's other end is closed
                more = b""
            if more:
                self.faults.append(f"heard more: {more!r}")

    def _hear(self, n):
        heard = b""
        end = time.monotonic() + PATIENCE_S
        while len(heard) < n and time.monotonic() < end and not self._over.is_set():
            if select.select([self.fd], [], [], 0.01)[0]:
                heard += os.read(self.fd, n - len(heard))
        return heard


@pytest.fixture
def wires():
    """The script's vocabulary."""

    class Wires:
        expect, say, hang_up = Expect, Say, HangUp

    return Wires


@pytest.fixture
def serial_peer():
    """Start a peer on a terminal; returns it, its `port` being the name to open."""
    peers, ends = [], []

    def start(*script):
        master, slave = os.openpty()
        tty.setraw(master)
        tty.setraw(slave)
        ends.append(slave)
        peer = Peer(master, script)
        peer.port = os.ttyname(slave)
        peers.append(peer)
        return peer

    yield start
    for peer in peers:
        peer.finish()
    for end in ends:
        os.close(end)


@pytest.fixture
def tcp_peer():
    """Listen, one script for each connection in turn; returns the port."""
    peers, listeners, threads = [], [], []

    def start(*scripts):
        listener = socket.create_server(("127.0.0.1", 0))
        listener.settimeout(PATIENCE_S)
        listeners.append(listener)

        def accept():
            for script in scripts:
                connection, _ = listener.accept()
                peers.append(Peer(connection.detach(), script))

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        threads.append(thread)
        return listener.getsockname()[1]

    yield start
    for thread in threads:
        thread.join(PATIENCE_S)
        assert not thread.is_alive(), "a connection was never made"
    for peer in peers:
        peer.finish()
    for listener in listeners:
        listener.close()
