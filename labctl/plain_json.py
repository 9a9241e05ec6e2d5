"""Values as plain JSON (objects, lists, numbers, text, booleans, null), and back into dataclasses by their types.

What is written is read again to the last bit and of the same kind: 3 stays 3 where a number may have decimals, None
stays None, tuples come back as tuples. What does not fit a dataclass's types is refused, never converted.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")
Reader = Callable[[Any, str], Any]

UNWRITTEN = "not written at its default"
_KINDS = {str: "text", bool: "true or false", int: "a whole number", float: "a number", NoneType: "null"}


class NotPlain(ValueError):
    """A value that JSON does not hold exactly, or JSON that does not fit the types it is read into."""


def to_json(value: object, where: str = "", *, lossy: bool = False) -> Any:  # noqa: ANN401 - whatever JSON holds
    """`value` as plain JSON, a dataclass as an object with its fields in order; `where` names it in errors.

    A field whose metadata has `UNWRITTEN` is left out where it has its default: records that were written before
    there was such a field stay as they are, byte for byte.

    `lossy` is for output that is not read back: NaN and infinity become null, numpy's arrays and numbers plain ones,
    and keys need not be text.

    Raises:
        NotPlain: JSON does not hold it exactly: NaN, infinity, a key that is not text, another type.
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return _finite(value, where, lossy)
    if isinstance(value, (list, tuple)):
        return [to_json(item, f"{where}[{index}]", lossy=lossy) for index, item in enumerate(value)]
    if is_dataclass(value):
        inside = {
            field.name: getattr(value, field.name)
            for field in fields(value)
            if UNWRITTEN not in field.metadata or getattr(value, field.name) != field.default
        }
        return {name: to_json(item, _inside(where, name), lossy=lossy) for name, item in inside.items()}
    if isinstance(value, Mapping):
        keys = [key for key in value if not isinstance(key, str)]
        if keys and not lossy:
            raise NotPlain(f"{where} has the key {keys[0]!r}: a record holds keys that are text only")
        return {key: to_json(item, _inside(where, key), lossy=lossy) for key, item in value.items()}
    if lossy and hasattr(value, "tolist"):
        return to_json(value.tolist(), where, lossy=lossy)
    raise NotPlain(
        f"{where} is of type {type(value).__name__}, which a record does not hold; make it plain first"
    )


def from_json(kind: type[T], value: Any, where: str = "") -> T:  # noqa: ANN401 - whatever JSON holds
    """The dataclass `kind` from plain JSON, as `to_json` made it; a field that is missing has its default.

    Raises:
        NotPlain: a field is of another type, is missing and has no default, or is none of the dataclass's.
    """
    hashable: Any = kind
    read: T = _reader(hashable)(value, where or kind.__name__)
    return read


def _finite(value: float, where: str, lossy: bool) -> float | None:
    if math.isfinite(value):
        return value
    if lossy:
        return None
    raise NotPlain(
        f"{where} is {value}: {value} has no place in a record: numbers are finite, None where there is none"
    )


def _inside(where: str, name: object) -> str:
    return f"{where}.{name}" if where else str(name)


@cache
def _reader(kind: Any) -> Reader:  # noqa: ANN401 - a type, or what typing makes of one
    """What reads a value of this type; it is given the value, and where it is."""
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any:
        return lambda value, where: value
    if kind in _KINDS:
        return _simple_reader(kind)
    if is_dataclass(kind):
        return _dataclass_reader(kind)
    if origin is Literal:
        return _literal_reader(parts)
    if origin is tuple and parts[1:] == (...,):
        return _tuple_reader(_reader(parts[0]))
    if origin is Mapping and parts[0] is str:
        return _mapping_reader(_reader(parts[1]))
    if origin is UnionType and len(parts) == 2 and parts[1] is NoneType:
        return _optional_reader(_reader(parts[0]))
    raise TypeError(
        f"no JSON is read into {kind}; use a dataclass, tuple[X, ...], Mapping[str, X] or X | None"
    )


def _simple_reader(kind: type) -> Reader:
    # An integer is a number, and stays an integer; a truth value is neither.
    fitting: tuple[type, ...] = (float, int) if kind is float else (kind,)

    def read(value: Any, where: str) -> Any:  # noqa: ANN401 - whatever JSON holds
        if not isinstance(value, fitting) or (isinstance(value, bool) and kind is not bool):
            raise NotPlain(f"{where} is {value!r}, and not {_KINDS[kind]}")
        return value

    return read


def _literal_reader(choices: tuple[object, ...]) -> Reader:
    def read(value: Any, where: str) -> Any:  # noqa: ANN401 - whatever JSON holds
        if value not in choices:
            raise NotPlain(f"{where} is {value!r}, and none of {', '.join(map(repr, choices))}")
        return value

    return read


def _tuple_reader(read_item: Reader) -> Reader:
    def read(value: Any, where: str) -> tuple[Any, ...]:  # noqa: ANN401 - whatever JSON holds
        if not isinstance(value, list):
            raise NotPlain(f"{where} is {value!r}, and not a list")
        return tuple(read_item(item, f"{where}[{index}]") for index, item in enumerate(value))

    return read


def _mapping_reader(read_item: Reader) -> Reader:
    def read(value: Any, where: str) -> dict[str, Any]:  # noqa: ANN401 - whatever JSON holds
        _require_object(value, where)
        return {name: read_item(item, _inside(where, name)) for name, item in value.items()}

    return read


def _optional_reader(read_item: Reader) -> Reader:
    return lambda value, where: None if value is None else read_item(value, where)


def _dataclass_reader(kind: Any) -> Reader:  # noqa: ANN401 - a dataclass
    hints = get_type_hints(kind)
    readers = {field.name: _reader(hints[field.name]) for field in fields(kind)}
    needed = {
        field.name for field in fields(kind) if field.default is MISSING and field.default_factory is MISSING
    }

    def read(value: Any, where: str) -> Any:  # noqa: ANN401 - an instance of `kind`
        _require_object(value, where)
        if unknown := value.keys() - readers.keys():
            raise NotPlain(f"{where} has {', '.join(sorted(unknown))}, which is not known")
        if missing := needed - value.keys():
            raise NotPlain(f"{where} lacks {', '.join(sorted(missing))}")
        return kind(**{name: readers[name](item, _inside(where, name)) for name, item in value.items()})

    return read


def _require_object(value: object, where: str) -> None:
    if not isinstance(value, dict):
        raise NotPlain(f"{where} is {value!r}, and not an object")
