"""The clients that are run: where each comes from, its script, and what it is pointed at."""

from dataclasses import dataclass
from typing import Literal

Target = Literal[
    "regulator ASCII",
    "regulator Modbus RTU",
    "valves Modbus RTU",
    "valves Modbus TCP",
    "markers",
    "pymodbus's own server",
]


@dataclass(frozen=True)
class Differences:
    """Operations that a client cannot do on a double, and the reason, a sentence or two."""

    operations: frozenset[str]
    why: str


@dataclass(frozen=True)
class Client:
    """A client written elsewhere.

    `packages` are pinned, from PyPI; `program` is one that the machine has or has not; `variable` names the
    environment variable that says where the user has it; `own` is labctl's driver, on a server written elsewhere.
    `script` is run as `script *arguments ADDRESS`. `differences` names the operations that
    are known to be refused, and says why.
    """

    name: str
    script: str
    target: Target
    arguments: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    least_python: tuple[int, int] = (3, 11)
    program: str | None = None
    variable: str | None = None
    own: bool = False
    differences: Differences | None = None


_MINIMALMODBUS = ("minimalmodbus==2.1.1",)
_UMODBUS = ("uModbus==1.0.4",)
_PYMODBUS = ("pymodbus==3.16.1", "pyserial==3.5")
_MODBUS_TK = ("modbus_tk==1.1.5", "pyserial==3.5")

_NUMAT_DIFFERENCES = Differences(
    frozenset(
        {
            "get (reads register 122 first)",
            "get: the setpoint",
            "get: the pressure has come",
            "is_locked",
            "is_locked again",
        }
    ),
    "This client is made for flow controllers: it reads a data frame of 5 columns or more, and raises on the 3 of a "
    "pressure controller (hardware.md, section 1a), so `get` and `is_locked` cannot work on one. Its `tare_pressure` "
    "is `$$PC`, the tare of an absolute pressure, and register 122 for a mass flow: a gauge controller has neither.",
)
_ALICATLIB_DIFFERENCES = Differences(
    frozenset({"auto_tare", "lock_display"}),
    "`auto_tare` asks `ZCA`, whose answer no manual or capture that we have shows, so the double does not know it; "
    "`lock_display` is refused by the client itself, which asks at opening whether there is a display and does not "
    "take the double's answer for one.",
)

CLIENTS: tuple[Client, ...] = (
    Client(
        "numat alicat",
        "numat_alicat_client.py",
        "regulator ASCII",
        packages=("alicat==0.9.0",),
        differences=_NUMAT_DIFFERENCES,
    ),
    Client(
        "alicatlib",
        "alicatlib_client.py",
        "regulator ASCII",
        packages=("alicatlib==0.3.1",),
        least_python=(3, 13),
        differences=_ALICATLIB_DIFFERENCES,
    ),
    Client("labmcp-alicat", "labmcp_alicat_client.py", "regulator ASCII", packages=("labmcp-alicat==0.1.2",)),
    Client("minimalmodbus", "minimalmodbus_client.py", "regulator Modbus RTU", packages=_MINIMALMODBUS),
    Client("minimalmodbus", "relay_minimalmodbus.py", "valves Modbus RTU", packages=_MINIMALMODBUS),
    Client("pyModbusTCP", "relay_pymodbustcp.py", "valves Modbus TCP", packages=("pyModbusTCP==0.3.1",)),
    Client("uModbus", "umodbus_client.py", "regulator Modbus RTU", packages=_UMODBUS),
    Client("uModbus", "relay_umodbus.py", "valves Modbus RTU", packages=_UMODBUS),
    Client("uModbus", "relay_umodbus.py", "valves Modbus TCP", packages=_UMODBUS),
    Client("modbus_tk", "modbus_tk_client.py", "regulator Modbus RTU", packages=_MODBUS_TK),
    Client("modbus_tk", "relay_modbus_tk.py", "valves Modbus RTU", packages=_MODBUS_TK),
    Client("modbus_tk", "relay_modbus_tk.py", "valves Modbus TCP", packages=_MODBUS_TK),
    Client("pymodbus", "relay_pymodbus.py", "valves Modbus RTU", packages=_PYMODBUS),
    Client("pymodbus", "relay_pymodbus.py", "valves Modbus TCP", packages=_PYMODBUS),
    Client("labctl's relay driver", "relay_driver_on_pymodbus.py", "pymodbus's own server", own=True),
    Client("mbpoll", "mbpoll_client.py", "regulator Modbus RTU", ("regulator",), program="mbpoll"),
    Client("mbpoll", "mbpoll_client.py", "valves Modbus RTU", ("valves",), program="mbpoll"),
    # It has no licence grant: it is run from where the user has it, and never fetched.
    Client("owl.py", "owl_client.py", "markers", variable="OWL_PY"),
)
