# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads JSON into dataclasses: a field is a key, its type says what the value must be."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

from .errors import InputError, listed
from .options import unknown

Record = TypeVar("Record")

NAMES = {str: "a text", int: "a whole number", bool: "true or false", dict: "an object", list: "a list"}


def read_record(kind: type[Record], data: Any, place: str) -> Record:
    """The dataclass that `data` describes.

    Fields may be `str`, `int`, `bool`, `Any`, dataclasses, tuples of one of them (`tuple[str, ...]`, a list in JSON),
    `dict[str, ...]`, and any of these or None. A key that is no field, a missing one without a default, or a value
    of another type is an InputError that names the key and its place.
    """
    _expect(isinstance(data, dict), data, dict, place)
    hints = typing.get_type_hints(kind)
    fields = {field.name: field for field in dataclasses.fields(typing.cast(Any, kind))}
    for key in data:
        if key not in fields:
            raise InputError(unknown(key, fields, "key", place))
    missing = [name for name, field in fields.items() if name not in data and _has_no_default(field)]
    if missing:
        raise InputError(f"{place} lacks {listed(missing)}.")
    return kind(**{key: _value(hints[key], value, f"{place}.{key}") for key, value in data.items()})


def _value(hint: Any, value: Any, place: str) -> Any:
    """`value` as the type wants it."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (typing.Union, types.UnionType):
        inner = next(argument for argument in arguments if argument is not type(None))
        return None if value is None else _value(inner, value, place)
    if origin is tuple:
        _expect(isinstance(value, list), value, list, place)
        return tuple(_value(arguments[0], item, f"{place}[{number}]") for number, item in enumerate(value))
    if origin is dict:
        _expect(isinstance(value, dict), value, dict, place)
        return {key: _value(arguments[1], item, f"{place}.{key}") for key, item in value.items()}
    if dataclasses.is_dataclass(hint):
        return read_record(typing.cast(type[Any], hint), value, place)
    _expect(type(value) is hint, value, hint, place)
    return value


def _has_no_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _expect(fits: bool, value: Any, wanted: type, place: str) -> None:
    if not fits:
        shown = NAMES[type(value)] if isinstance(value, (dict, list)) else repr(value)
        raise InputError(f"{place} must be {NAMES[wanted]}, not {shown}.")


def no_twice(pairs: list[tuple[str, Any]]) -> Mapping[str, Any]:
    """For `json.loads(object_pairs_hook=...)`: a key that comes twice is an InputError."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"The key '{key}' comes twice in one object.")
        found[key] = value
    return found
