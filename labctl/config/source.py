"""From a file to its TOML table, with the line of every key."""

import re
import stat
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labctl.config.errors import ConfigError, Problem
from labctl.config.locate import KeyPath, key_lines
from labctl.errors import BadInput

MAX_BYTES = 1 << 20
_AT_LINE = re.compile(r"\s*\(at line (\d+), column (\d+)\)")


@dataclass(frozen=True)
class Document:
    """A parsed file: where it came from, its text, its table as TOML has it, and the line of each key path."""

    source: str
    text: str
    table: Mapping[str, Any]
    lines: Mapping[KeyPath, int]


def read_document(path: Path) -> Document:
    """Read and parse a TOML file.

    Raises:
        BadInput: no such file, not a regular file, too large, unreadable, or not UTF-8.
        ConfigError: not TOML.
    """
    try:
        about = path.stat()
        if stat.S_ISDIR(about.st_mode):
            raise BadInput(f"{path}: is a directory; name the TOML file in it")
        # A pipe or a device could keep the read waiting for ever.
        if not stat.S_ISREG(about.st_mode):
            raise BadInput(f"{path}: is not a regular file; name a TOML file")
        if about.st_size > MAX_BYTES:
            raise BadInput(
                f"{path}: has {about.st_size} bytes, above the limit of {MAX_BYTES}; name a TOML file"
            )
        content = path.read_bytes()
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; check the path") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise BadInput(f"{path}: cannot be read ({reason}); check the path and its permissions") from None
    return parse_document(content, str(path))


def parse_document(content: bytes, source: str) -> Document:
    """Parse the bytes of a TOML file; a byte order mark is allowed.

    Raises:
        BadInput: not UTF-8.
        ConfigError: not TOML.
    """
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise BadInput(f"{source}:{line}: is not UTF-8 text; save the file as UTF-8") from None
    try:
        return Document(source, text, tomllib.loads(text), key_lines(text))
    except RecursionError:
        problem = Problem(source, 1, "", None, "is nested too deep; a configuration file needs three levels")
        raise ConfigError([problem]) from None
    except ValueError as error:
        raise ConfigError([_syntax_problem(source, text, str(error))]) from None


def _syntax_problem(source: str, text: str, message: str) -> Problem:
    at = _AT_LINE.search(message)
    line = int(at[1]) if at else text.count("\n") + 1
    column = f" at column {at[2]}" if at else ""
    what = _AT_LINE.sub("", message).removesuffix("(at end of document)").strip()
    return Problem(source, line, "", None, f"is not valid TOML{column}: {what}")
