"""What a command runs on, and what is known of its rig meanwhile, so that a failure can report it too."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from labctl.holder.interfaces import Holders
    from labctl.rig.platform import Platform
    from labctl.rig.presence import Presence
    from labctl.safety.safe_state import SafeReport


@dataclass
class Outcome:
    """Filled in while a command runs: whether its rig is simulated, and what was last read back from it.

    `on` is the platform to open rigs on, None for this machine. `presence` answers for the command in other terminals
    while it holds a rig.
    """

    on: "Platform | None" = None
    simulated: bool | None = None
    report: "SafeReport | None" = None
    presence: "Presence | None" = None

    @classmethod
    def current(cls) -> "Outcome":
        """The running command's."""
        outcome = click.get_current_context().find_object(cls)
        return cls() if outcome is None else outcome

    @property
    def platform(self) -> "Platform":
        """What the command's rig is opened on."""
        from labctl.rig.platform import SYSTEM

        return self.on or SYSTEM

    @property
    def holders(self) -> "Holders":
        """What finds who holds a rig; without the instruments' side, which takes longer to import."""
        from labctl.holder.system import SystemHolders

        return self.on.holders if self.on is not None else SystemHolders()

    def for_machines(self) -> Mapping[str, Any]:
        """What a failed command's JSON holds beside its error."""
        fields: dict[str, Any] = {}
        if self.simulated is not None:
            fields["simulated"] = self.simulated
        if self.report is not None:
            fields["safe"] = self.report.safe
        return fields
