"""The protocols that are installed, by entry point, so that a laboratory can add its own."""

from importlib.metadata import EntryPoint, entry_points

from labctl.config.validate import suggestion
from labctl.errors import BadInput, LabError
from labctl.session.contract import Protocol

GROUP = "labctl.protocols"


def protocol_names() -> tuple[str, ...]:
    """The names of the installed protocols, sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=GROUP)}))


def find_protocol(name: str) -> Protocol:
    """The protocol of a name.

    Raises:
        BadInput: none has it.
        LabError: it cannot be loaded, is none, or two packages give one name to theirs.
    """
    entries = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not entries:
        raise BadInput(f"no protocol named {name!r}; {suggestion(name, protocol_names())}")
    # A package that is installed twice (a checkout over a release) names the same object twice.
    if len({entry.value for entry in entries}) > 1:
        values = ", ".join(sorted(entry.value for entry in entries))
        raise LabError(f"protocol {name!r} is offered by {values}; uninstall or rename one")
    return _load(entries[0])


def package_of(name: str) -> dict[str, str]:
    """The package that offers a protocol, and its version; nothing where that is not known."""
    offering = [entry.dist for entry in entry_points(group=GROUP) if entry.name == name]
    return {dist.name: dist.version for dist in offering if dist is not None}


def _load(entry: EntryPoint) -> Protocol:
    try:
        protocol = entry.load()
    # A laboratory's own package may fail in any way.
    except Exception as error:
        raise LabError(f"protocol {entry.name!r} ({entry.value}) cannot be loaded: {error!r}") from error
    if not isinstance(protocol, Protocol):
        raise LabError(f"protocol {entry.name!r} ({entry.value}) is no labctl.session.contract.Protocol")
    return protocol
