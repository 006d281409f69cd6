# SPDX-License-Identifier: GPL-3.0-or-later
"""Hears what operators report, in the words that a user would see."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_listeners: list[list[dict[str, str]]] = []


@contextmanager
def heard() -> Iterator[list[dict[str, str]]]:
    """A list that grows by a dictionary of level and text for each report of our operators."""
    found: list[dict[str, str]] = []
    _listeners.append(found)
    try:
        yield found
    finally:
        _listeners.remove(found)


def hear(levels: set[str], text: str) -> None:
    """An operator reports."""
    for found in _listeners:
        found.extend({"level": level, "text": text} for level in sorted(levels))
