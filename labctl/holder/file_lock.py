"""A lock on a file of which the kernel says who holds it, and which it takes back however that process ends.

A POSIX record lock, not flock: it is the process's own, so that no child keeps it, and F_GETLK answers with the
number of the process, which nobody can write. Its flaw: a process that closes any descriptor of the file lets go.
"""

import fcntl
import os
import struct
import sys

_MAC = sys.platform == "darwin"
# struct flock: type, whence, start, length, process; on macOS in another order.
_LAYOUT = "qqihh" if _MAC else "hhqqi0q"


def take(descriptor: int) -> bool:
    """Take the lock, at once or not at all; returns whether it was."""
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def locked_by(descriptor: int) -> int | None:
    """The process that holds the lock; 0 where it is of a container that is not ours; None where nobody does."""
    if _MAC:
        asked = struct.pack(_LAYOUT, 0, 0, 0, fcntl.F_WRLCK, os.SEEK_SET)
        *_, process, kind, _ = struct.unpack(_LAYOUT, fcntl.fcntl(descriptor, fcntl.F_GETLK, asked))
    else:
        asked = struct.pack(_LAYOUT, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
        kind, *_, process = struct.unpack(_LAYOUT, fcntl.fcntl(descriptor, fcntl.F_GETLK, asked))
    return None if kind == fcntl.F_UNLCK else max(0, process)
