"""This process as the holder of a rig."""

import os
import time
from pathlib import Path
from typing import Literal

from labctl.holder.records import Holder
from labctl.this_process import command_line, user_name


def this_holder(
    kind: Literal["command", "guard"],
    rig_name: str,
    source: str,
    *,
    simulated: bool,
    command: str | None = None,
) -> Holder:
    """Who this process is, from now on; `command` in place of its command line."""
    try:
        folder = str(Path.cwd())
    except OSError:
        folder = "a folder that is gone"
    return Holder(
        kind=kind,
        pid=os.getpid(),
        user=user_name(),
        command=command or command_line(),
        folder=folder,
        since=time.strftime("%Y-%m-%d %H:%M:%S"),
        rig_name=rig_name,
        source=source,
        simulated=simulated,
    )
