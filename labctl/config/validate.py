"""Check a parsed file against its schema and word what is wrong."""

import difflib
import json
import math
import re
from collections.abc import Iterable, Mapping
from datetime import date, time
from typing import TYPE_CHECKING, TypeVar, get_args, get_origin

from pydantic import BaseModel, PlainValidator, ValidationError
from pydantic.fields import FieldInfo

from labctl.config.errors import Problem
from labctl.config.locate import KeyPath, line_of
from labctl.config.source import Document

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

MAX_VALUE_LETTERS = 60
_ABSENT = object()
_BARE_KEY = re.compile("[A-Za-z0-9_-]+")

Schema = TypeVar("Schema", bound=BaseModel)


def validate(document: Document, schema: type[Schema]) -> tuple[Schema | None, list[Problem]]:
    """The document as its schema, or None and every mistake that the schema sees."""
    try:
        return schema.model_validate(document.table), []
    except ValidationError as error:
        found = error.errors(include_url=False)
    return None, [_explained(document, schema, one) for one in found]


def problem_at(document: Document, path: KeyPath, message: str) -> Problem:
    """A mistake at a key path of the document, with the value that is there."""
    value = _value_at(document.table, path)
    shown = None if value is _ABSENT or _is_tables(value) else show(value)
    return Problem(document.source, line_of(document.lines, path), key_text(document, path), shown, message)


def _is_tables(value: object) -> bool:
    """A table, or an array with tables in it: too much to be shown in a line."""
    inside = value if isinstance(value, list) else [value]
    return any(isinstance(one, Mapping) for one in inside)


def key_text(document: Document, path: KeyPath) -> str:
    """A key path as a person reads it, `fibers[id x35].start`; elements without an id count from 1."""
    text = ""
    for end, part in enumerate(path, start=1):
        if isinstance(part, str):
            key = part if _BARE_KEY.fullmatch(part) else json.dumps(part)
            text += f".{key}" if text else key
            continue
        element = _value_at(document.table, path[:end])
        name = element.get("id") if isinstance(element, Mapping) else None
        named = (isinstance(name, str) and name.isprintable() and name) or type(name) is int
        text += f"[id {name}]" if named else f"[#{part + 1}]"
    return text


def show(value: object) -> str:
    """A value as the file would have it, shortened."""
    if isinstance(value, float) and not math.isfinite(value):
        text = str(value)
    elif isinstance(value, date | time):
        text = value.isoformat()
    else:
        text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= MAX_VALUE_LETTERS else f"{text[: MAX_VALUE_LETTERS - 3]}..."


def suggestion(word: str, known: Iterable[str]) -> str:
    """A "did you mean" for a word that is not known, else the known ones."""
    names = sorted(known)
    close = difflib.get_close_matches(word, names, n=1)
    if close:
        return f'did you mean "{close[0]}"?'
    return f"known are {', '.join(names)}" if names else "none is known"


def _explained(document: Document, schema: type[BaseModel], found: "ErrorDetails") -> Problem:
    kind = found["type"]
    path = _key_path(found["loc"])
    field = _field_at(schema, path)
    if kind == "value_error":
        message = str(found["ctx"]["error"])
        if _value_at(document.table, path) is _ABSENT:
            message += " (the key is left out, so its default counts)"
    elif kind == "missing":
        message = f"is missing; {_how_to_add(path, field)}"
    elif kind == "extra_forbidden":
        message = f"unknown key; {suggestion(str(path[-1]), _keys_around(schema, path))}"
    elif kind in {"model_type", "dict_type"}:
        message = "must be a table of keys and values"
    elif kind == "list_type":
        message = "must be an array"
    else:
        message = found["msg"]
    return problem_at(document, path, message)


def _key_path(loc: KeyPath) -> KeyPath:
    """A pydantic location without its own mark for a mistaken name in a table."""
    return tuple(part for part in loc if part != "[key]")


def _how_to_add(path: KeyPath, field: FieldInfo | None) -> str:
    if allowed := _allowed(field):
        return f"it must be {allowed}"
    table = ".".join(map(str, path))
    is_array = field is not None and get_origin(field.annotation) is list
    return f"add [[{table}]]" if is_array else f"add [{table}]"


def _allowed(field: FieldInfo | None) -> str | None:
    for mark in field.metadata if field is not None else ():
        if isinstance(mark, PlainValidator):
            return getattr(mark.func, "allowed", None)
    return None


def _field_at(schema: type[BaseModel], path: KeyPath) -> FieldInfo | None:
    field: FieldInfo | None = None
    model: type[BaseModel] | None = schema
    for part in path:
        if isinstance(part, int):
            continue
        if model is None or part not in model.model_fields:
            return None
        field = model.model_fields[part]
        model = _model_of(field)
    return field


def _keys_around(schema: type[BaseModel], path: KeyPath) -> list[str]:
    """The keys of the table that the last key of a path stands in."""
    field = _field_at(schema, path[:-1])
    model = _model_of(field) if field is not None else schema
    return list(model.model_fields) if model is not None else []


def _model_of(field: FieldInfo) -> type[BaseModel] | None:
    for kind in (field.annotation, *get_args(field.annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _value_at(table: object, path: KeyPath) -> object:
    value = table
    for part in path:
        if isinstance(part, str):
            value = value.get(part, _ABSENT) if isinstance(value, Mapping) else _ABSENT
        else:
            value = value[part] if isinstance(value, list) and part < len(value) else _ABSENT
    return value
