"""The firmware that an Alicat double can have: how it shows its numbers, and which commands it knows.

Sources: public captures of flow controllers with firmware 5v12 to 10v20 and of a GP07R100 (alicatlib's fixtures and
device matrix; docs/reference/hardware.md, 1a), turned here into a gauge pressure controller of 15 PSIG. No capture of
a GP table is public: its form is that of 5v12, with the padding that is described of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

FirmwareName = Literal["5v12", "6v21", "7v09", "8v17", "8v30", "9v00", "10v05", "10v20", "gp"]
FIRMWARES: tuple[FirmwareName, ...] = get_args(FirmwareName)
NEWEST: FirmwareName = "10v20"

_WORDS_6 = ("OPL", "POV", "HLD", "EXH", "LCK")
_WORDS_8 = ("OPL", "POV", "P2O", "HLD", "EXH", "LCK")
_WORDS_10 = ("OPL", "POV", "P2O", "COM", "HLD", "EXH", "GTA", "LCK")


@dataclass(frozen=True)
class Unit:
    """The unit that the device is set to: one of it in psi, its number and its name."""

    psi: float
    code: int
    label: str


PSIG = Unit(1.0, 10, "PSIG")
BARG = Unit(14.503773773, 7, "BARG")


@dataclass(frozen=True)
class Shown:
    """A number in the data frame: characters with the sign, decimals, and whether it has a sign."""

    width: int = 7
    decimals: int = 2
    signed: bool = True

    def format(self, value: float) -> str:
        """The number as the device shows it."""
        # Adding 0 makes a rounded -0.0 a plain zero.
        rounded = round(value, self.decimals) + 0.0
        if self.signed:
            return f"{rounded:+0{self.width}.{self.decimals}f}"
        return f"{max(0.0, rounded):0{self.width}.{self.decimals}f}"


@dataclass(frozen=True)
class Variant:
    """One firmware.

    `number` is (major, minor), None for GP. `version_date` is what `VE` shows behind the revision, None where `VE`
    is silent. `older_table`: `??D*` without statistic numbers.
    """

    revision: str
    number: tuple[int, int] | None
    version_date: str | None
    status_words: tuple[str, ...]
    setpoint: Shown = Shown()
    pressure: Shown = Shown()
    older_table: bool = False

    @property
    def is_gp(self) -> bool:
        """Commands are read only after `$$`, and what is not known is left unanswered."""
        return self.number is None

    @property
    def locks_by_l(self) -> bool:
        """Every command that begins with L locks the front panel and is answered by a data frame."""
        return self.number is not None and self.number < (9, 0)

    def knows(self, first: tuple[int, int]) -> bool:
        """The firmware is of this version or later."""
        return self.number is not None and self.number >= first


VARIANTS: Mapping[FirmwareName, Variant] = MappingProxyType(
    {
        "gp": Variant(
            "GP07R100", None, None, ("LCK", "POV", "HLD", "EXH"), Shown(6, 2, False), older_table=True
        ),
        "5v12": Variant(
            "5v12.0-R22",
            (5, 12),
            "Aug 14 2015,10:12:31",
            ("LCK", "POV", "HLD", "EXH"),
            Shown(6, 2, False),
            older_table=True,
        ),
        "6v21": Variant("6v21.0-R22", (6, 21), "Nov 30 2016,16:04:20", _WORDS_6, Shown(6, 1, False)),
        "7v09": Variant("7v09.0-R22", (7, 9), "May  3 2018,09:41:12", _WORDS_6, Shown(6, 2, False)),
        "8v17": Variant("8v17.0-R23", (8, 17), None, _WORDS_8),
        "8v30": Variant("8v30.0-R23", (8, 30), "Jun  9 2021,11:20:44", _WORDS_8),
        "9v00": Variant("9v00.0-R24", (9, 0), "Feb 21 2022,08:30:02", _WORDS_8),
        "10v05": Variant("10v05.0-R24", (10, 5), "Mar  7 2023,13:55:19", _WORDS_10),
        "10v20": Variant("10v20.0-R24", (10, 20), "Jan  9 2025,15:04:07", _WORDS_10),
    }
)
