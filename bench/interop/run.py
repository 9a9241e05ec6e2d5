"""Run clients that were written elsewhere against the doubles, and write down how each operation went.

    python bench/interop/run.py [--only TEXT] [--page FILE]

Environment: INTEROP_PYTHON, a newer Python for clients that need one; OWL_PY, the folder of the vendor's owl.py.
Exit code 1 where an operation went wrong, or was refused without a known reason (clients.py).
"""

import argparse
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from clients import CLIENTS, Client, Target
from environments import AbsentError, python_with
from page import Ran, Row, page_of

from labctl import __version__

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WORK = ROOT / "runs" / "interop"
PAGE = ROOT / "docs" / "results" / "interop.md"
START_TIMEOUT_S = 300.0
CLIENT_TIMEOUT_S = 120.0
DETAIL_CHARACTERS = 160


def main() -> int:
    """Serve the doubles, run every client, print and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="run the clients whose name or double contains this")
    parser.add_argument("--page", type=Path, default=PAGE, help="where the page is written")
    chosen = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    clients = [one for one in CLIENTS if chosen.only.lower() in f"{one.name} {one.target}".lower()]
    with ExitStack() as stack:
        print("starting the doubles", flush=True)
        addresses = dict[Target, str]()
        for options in (("alicat-ascii", "rtu"), ("alicat-modbus", "tcp")):
            addresses |= stack.enter_context(served(*options))
        runs = [told(run_client(client, addresses.get(client.target, ""))) for client in clients]
    about = f"labctl {__version__}, Python {platform.python_version()}, {platform.system()}"
    chosen.page.write_text(page_of(runs, time.strftime("%Y-%m-%d"), about), encoding="utf-8")
    print(f"written to {chosen.page}")
    return int(any(ran.unexplained() for ran in runs))


@contextmanager
def served(regulator: str, valves: str) -> Iterator[dict[Target, str]]:
    """Doubles in a process of their own, and the address of each."""
    rig = WORK / f"{regulator}-{valves}.toml"
    command = [sys.executable, "-m", "labctl", "doubles", "serve", "--json", "--out", str(rig)]
    process = subprocess.Popen(
        [*command, "--regulator", regulator, "--valves", valves], stdout=subprocess.PIPE, cwd=ROOT, text=True
    )
    timer_s = time.monotonic() + START_TIMEOUT_S
    try:
        assert process.stdout is not None  # noqa: S101 - it was asked for
        if not process.stdout.readline() or time.monotonic() > timer_s:
            raise SystemExit(f"the doubles with {regulator} and {valves} did not start")
        yield addresses_of(tomllib.loads(rig.read_text()), regulator, valves)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()


def addresses_of(rig: dict[str, Any], regulator: str, valves: str) -> dict[Target, str]:
    """Where a client finds each double of a rig."""
    found: dict[Target, str] = {}
    found["regulator ASCII" if regulator == "alicat-ascii" else "regulator Modbus RTU"] = rig["regulator"][
        "port"
    ]
    if valves == "rtu":
        found["valves Modbus RTU"] = rig["valves"]["port"]
    else:
        found["valves Modbus TCP"] = f"{rig['valves']['host']}:{rig['valves']['tcp_port']}"
    found["markers"] = f"{rig['markers']['host']}:{rig['markers']['server_number']}"
    return found


def run_client(client: Client, address: str) -> Ran:
    """Run one client to its end."""
    version = client.packages[0].partition("==")[2] if client.packages else ""
    try:
        python, first = environment_of(client)
    except AbsentError as absent:
        return Ran(client.name, version, client.target, (), str(absent))
    command = [str(python), str(HERE / client.script), *client.arguments, *first, address]
    # The clients see their own packages, and nothing of this project's.
    surroundings = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=surroundings
    ) as process:
        try:
            out, err = process.communicate(timeout=CLIENT_TIMEOUT_S)
            ended = process.returncode
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
            ended = None
    rows = [
        Row(
            line["operation"],
            line["result"],
            line["detail"].replace(address or "\0", "ADDRESS")[:DETAIL_CHARACTERS],
        )
        for line in map(json.loads, filter(lambda text: text.startswith("{"), out.splitlines()))
    ]
    if ended is None:
        rows.append(Row("the whole", "wrong", f"did not end within {CLIENT_TIMEOUT_S:g} s"))
    elif ended:
        rows.append(Row("the whole", "wrong", (err.strip().splitlines() or [f"exit code {ended}"])[-1]))
    return Ran(client.name, version, client.target, tuple(rows), differences=client.differences)


def environment_of(client: Client) -> tuple[Path, tuple[str, ...]]:
    """The Python to run a client's script with, and what comes before the address.

    Raises:
        AbsentError: the client is not here.
    """
    if client.own:
        return Path(sys.executable), ()
    if client.variable is not None:
        folder = os.environ.get(client.variable)
        if folder is None:
            raise AbsentError(f"it is not fetched; name the folder that has it by {client.variable}")
        return Path(sys.executable), (folder,)
    if client.program is not None:
        if shutil.which(client.program) is None:
            raise AbsentError("the program is not on this machine")
        return Path(sys.executable), ()
    other = os.environ.get("INTEROP_PYTHON")
    return python_with(client.packages, client.least_python, WORK, other), ()


def told(ran: Ran) -> Ran:
    """Print how a client went, and return it."""
    print(
        f"\n{ran.client} {ran.version} on {ran.target}" + (f": not run, {ran.absent}" if ran.absent else "")
    )
    for row in ran.rows:
        print(f"  {row.result:16}{row.operation:42}{row.detail[:100]}", flush=True)
    return ran


if __name__ == "__main__":
    sys.exit(main())
