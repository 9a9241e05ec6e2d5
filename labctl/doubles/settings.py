"""What a set of doubles is made of."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from labctl.config.design import Design
from labctl.doubles.alicat_variants import NEWEST, FirmwareName
from labctl.doubles.fault_kinds import ASCII_ONLY, MODBUS_ONLY
from labctl.doubles.faults import Faults
from labctl.doubles.markers import MarkerSettings
from labctl.doubles.plant import PlantSettings
from labctl.doubles.reality_gap import RealityGap
from labctl.doubles.sheet import Relaxation
from labctl.errors import BadInput

RelayChannels = Literal[8, 16, 32]


@dataclass(frozen=True)
class DoublesSettings:
    """A simulated rig: its sheet, its instruments and what is wrong with them.

    `speed` is how fast its time runs against the wall's; `seed` draws all noise (the reality gap has a seed
    of its own). `regulator_firmware` is that of a regulator on ASCII, `second_gauge` the protocol of a second gauge
    on the chamber, None where there is none. `dump_channel` is the relay of a normally-open dump valve, None where
    there is none. `serial` is how serial devices are reached: by pseudo-terminals, or by sockets as behind an
    Ethernet box. `trace_path` takes the plant's truth as JSON lines.

    Raises:
        BadInput: a speed that is not above 0, a channel that the relay board does not have, or a firmware or fault
            that a regulator on Modbus cannot have.
    """

    design: Design
    regulator: Literal["alicat-ascii", "alicat-modbus"] = "alicat-ascii"
    regulator_firmware: FirmwareName = NEWEST
    valve_transport: Literal["rtu", "tcp"] = "rtu"
    serial: Literal["pty", "socket"] = "pty"
    relay_channels: RelayChannels = 32
    single_valve: bool = False
    speed: float = 1.0
    seed: int = 0
    gap: RealityGap = field(default_factory=RealityGap)
    relaxation: Relaxation = field(default_factory=Relaxation)
    markers: MarkerSettings = field(default_factory=MarkerSettings)
    faults: Faults = field(default_factory=Faults)
    dump_channel: int | None = None
    second_gauge: Literal["alicat-ascii", "alicat-modbus"] | None = None
    trace_path: Path | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed) and self.speed > 0):
            raise BadInput(f"speed {self.speed} of the simulated rig must be a finite number above 0")
        if self.relay_channels not in (8, 16, 32):
            raise BadInput(f"a relay board of {self.relay_channels} channels is not made: use 8, 16 or 32")
        self._check_regulator()
        if self.faults.gauge and self.second_gauge is None:
            raise BadInput("a fault of the second gauge needs one: add --second-gauge alicat-ascii")
        for fiber in self.design.fibers:
            self._check_channel(f"fiber {fiber.id} of design {self.design.name}", fiber.channel)
        if self.single_valve and self.dump_channel is None:
            raise BadInput(
                "a single-valve regulator cannot vent, and no rig.toml may hold one alone; give the simulated rig "
                "a dump valve too (--dump-channel)"
            )
        known = {point.id for point in self.markers.points}
        for fault in self.faults.markers:
            if unknown := sorted(set(fault.ids) - known):
                raise BadInput(
                    f"fault markers={fault.kind}: no marker has the id {', '.join(map(str, unknown))}; the simulated "
                    f"markers are {', '.join(map(str, sorted(known)))}"
                )
        if self.dump_channel is not None:
            self._check_channel("the dump valve", self.dump_channel)
            for fiber in self.design.fibers:
                if fiber.channel == self.dump_channel:
                    raise BadInput(
                        f"channel {self.dump_channel} is both the dump valve's and fiber {fiber.id}'s; "
                        "give the dump valve a channel of its own"
                    )

    def _check_regulator(self) -> None:
        for instrument, driver, faults, option in (
            ("regulator", self.regulator, self.faults.regulator, "--regulator"),
            ("gauge", self.second_gauge, self.faults.gauge, "--second-gauge"),
        ):
            for fault in faults:
                if fault.kind in MODBUS_ONLY and driver == "alicat-ascii":
                    raise BadInput(
                        f"fault {instrument}={fault.kind} is one of the Modbus protocol, and the {instrument} is "
                        f"{driver}: use {option} alicat-modbus"
                    )
        if self.regulator == "alicat-ascii":
            return
        if self.regulator_firmware != NEWEST:
            raise BadInput(
                f"firmware {self.regulator_firmware} shows on the ASCII protocol alone, and the regulator is "
                f"{self.regulator}: leave --regulator-firmware out, or use --regulator alicat-ascii"
            )
        for fault in self.faults.regulator:
            if fault.kind in ASCII_ONLY:
                raise BadInput(
                    f"fault regulator={fault.kind} is one of the ASCII protocol, and the regulator is "
                    f"{self.regulator}: use --regulator alicat-ascii"
                )

    def _check_channel(self, owner: str, channel: int) -> None:
        if not 1 <= channel <= self.relay_channels:
            raise BadInput(
                f"{owner} is on channel {channel}, and the simulated relay board has channels 1 to "
                f"{self.relay_channels}; use a board with more channels"
            )

    def plant(self) -> PlantSettings:
        """The plant that these settings ask for."""
        return PlantSettings(
            channels=self.relay_channels,
            dump_channel=self.dump_channel,
            single_valve=self.single_valve,
            relaxation=self.relaxation,
        )
