"""Load rig.toml and design files; every mistake of a file is reported at once, with its line."""

from importlib import resources
from pathlib import Path

from labctl.config.checks_design import design_problems
from labctl.config.checks_rig import rig_problems
from labctl.config.design import Design
from labctl.config.errors import ConfigError
from labctl.config.rig import RigConfig
from labctl.config.schema_design import DesignFile
from labctl.config.schema_rig import RigFile
from labctl.config.source import Document, parse_document, read_document
from labctl.config.validate import suggestion, validate
from labctl.errors import BadInput

#: The source of a rig whose file lives no longer than the doubles that it points at.
DOUBLES_FILE = "the doubles' own rig.toml"


def load_rig(path: str | Path) -> RigConfig:
    """Load a rig.toml.

    Raises:
        BadInput: the file cannot be read.
        ConfigError: it has mistakes.
    """
    return _rig(read_document(Path(path)))


def rig_from_text(text: str, source: str) -> RigConfig:
    """The rig of a file's text; `source` is where it came from.

    Raises:
        ConfigError: it has mistakes.
    """
    return _rig(parse_document(text.encode(), source))


def _rig(document: Document) -> RigConfig:
    rig, problems = validate(document, RigFile)
    problems += rig_problems(document)
    if rig is None or problems:
        raise ConfigError(problems)
    return rig.config(document.source)


def load_design(name_or_path: str | Path) -> Design:
    """Load a design: a bare name ("known") is one that ships with the package, anything else a path.

    Raises:
        BadInput: no such design, or the file cannot be read.
        ConfigError: it has mistakes.
    """
    return _design(_design_document(name_or_path))


def design_text(name_or_path: str | Path) -> str:
    """The text of a design file, to be kept and read again by `design_from_text`.

    Raises:
        BadInput: no such design, or the file cannot be read.
    """
    return _design_document(name_or_path).text


def design_from_text(text: str, source: str) -> Design:
    """The design of a file's text; `source` is where it came from.

    Raises:
        ConfigError: it has mistakes.
    """
    return _design(parse_document(text.encode(), source))


def _design(document: Document) -> Design:
    design, problems = validate(document, DesignFile)
    problems += design_problems(document)
    if design is None or problems:
        raise ConfigError(problems)
    return design.config(document.source)


def shipped_designs() -> tuple[str, ...]:
    """The names of the designs that ship with the package, sorted."""
    folder = resources.files("labctl") / "designs"
    return tuple(sorted(Path(file.name).stem for file in folder.iterdir() if file.name.endswith(".toml")))


def check_fit(design: Design, rig: RigConfig) -> None:
    """Check that the rig has a valve for every fiber that a pattern of the design stiffens.

    Raises:
        BadInput: a fiber's channel is not on the rig's board, or is that of the dump valve; names every one.
    """
    problems = []
    for fiber in design.fibers:
        patterns = sorted(name for name, ids in design.patterns.items() if fiber.id in ids)
        if not patterns:
            continue
        where = f"fiber {fiber.id} (pattern {', '.join(patterns)}) is on channel {fiber.channel}"
        if fiber.channel > rig.valves.channels:
            problems.append(f"{where}, but {rig.source} has valves.channels = {rig.valves.channels}")
        elif fiber.channel == rig.valves.dump_channel:
            problems.append(f"{where}, which is the dump valve's in {rig.source} (valves.dump_channel)")
    if problems:
        head = f"design {design.name} ({design.source}) does not fit rig {rig.name}; change the channels:"
        raise BadInput("\n".join([head, *problems]))


def _design_document(name_or_path: str | Path) -> Document:
    if isinstance(name_or_path, Path) or not _is_bare(name_or_path):
        return read_document(Path(name_or_path))
    if name_or_path not in shipped_designs():
        known = suggestion(name_or_path, shipped_designs())
        raise BadInput(
            f"no design named {name_or_path!r} ships with labctl; {known} "
            f"(for a file of your own give its path, ./{name_or_path}.toml)"
        )
    file = resources.files("labctl") / "designs" / f"{name_or_path}.toml"
    return parse_document(file.read_bytes(), f"labctl/designs/{name_or_path}.toml")


def _is_bare(name: str) -> bool:
    return bool(name) and "/" not in name and "\\" not in name and "." not in name and "\0" not in name
