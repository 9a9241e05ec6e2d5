"""The clients that are run: where each comes from, its script, and what it is pointed at."""

from dataclasses import dataclass
from typing import Literal

Target = Literal[
    "regulator ASCII", "regulator Modbus RTU", "valves Modbus RTU", "valves Modbus TCP", "markers"
]


@dataclass(frozen=True)
class Client:
    """A client written elsewhere.

    `packages` are pinned, from PyPI; `program` is one that the machine has or has not; `variable` names the
    environment variable that says where the user has it. `script` is run as `script *arguments ADDRESS`.
    """

    name: str
    script: str
    target: Target
    arguments: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    least_python: tuple[int, int] = (3, 11)
    program: str | None = None
    variable: str | None = None


_MINIMALMODBUS = ("minimalmodbus==2.1.1",)
_UMODBUS = ("uModbus==1.0.4",)
_MODBUS_TK = ("modbus_tk==1.1.5", "pyserial==3.5")

CLIENTS: tuple[Client, ...] = (
    Client("numat alicat", "numat_alicat_client.py", "regulator ASCII", packages=("alicat==0.9.0",)),
    Client(
        "alicatlib",
        "alicatlib_client.py",
        "regulator ASCII",
        packages=("alicatlib==0.3.1",),
        least_python=(3, 13),
    ),
    Client("labmcp-alicat", "labmcp_alicat_client.py", "regulator ASCII", packages=("labmcp-alicat==0.1.2",)),
    Client(
        "minimalmodbus",
        "minimalmodbus_client.py",
        "regulator Modbus RTU",
        ("regulator",),
        packages=_MINIMALMODBUS,
    ),
    Client(
        "minimalmodbus", "minimalmodbus_client.py", "valves Modbus RTU", ("valves",), packages=_MINIMALMODBUS
    ),
    Client("pyModbusTCP", "pymodbustcp_client.py", "valves Modbus TCP", packages=("pyModbusTCP==0.3.1",)),
    Client("uModbus", "umodbus_client.py", "regulator Modbus RTU", ("regulator",), packages=_UMODBUS),
    Client("uModbus", "umodbus_client.py", "valves Modbus TCP", ("valves",), packages=_UMODBUS),
    Client("modbus_tk", "modbus_tk_client.py", "regulator Modbus RTU", ("regulator",), packages=_MODBUS_TK),
    Client("modbus_tk", "modbus_tk_client.py", "valves Modbus TCP", ("valves",), packages=_MODBUS_TK),
    Client("mbpoll", "mbpoll_client.py", "regulator Modbus RTU", ("regulator",), program="mbpoll"),
    Client("mbpoll", "mbpoll_client.py", "valves Modbus RTU", ("valves",), program="mbpoll"),
    # It has no licence grant: it is run from where the user has it, and never fetched.
    Client("owl.py", "owl_client.py", "markers", variable="OWL_PY"),
)
