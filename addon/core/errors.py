# SPDX-License-Identifier: GPL-3.0-or-later
"""The error for what a user can put right."""


class InputError(ValueError):
    """What was given cannot be used; the message names the element and, where possible, the remedy.

    The message is a full sentence that ends with a full stop, so that a caller can add to it.
    """


def listed(names: list[str] | tuple[str, ...], limit: int = 8) -> str:
    """The names in quotes, separated by commas; what exceeds `limit` is only counted."""
    shown = ", ".join(f"'{name}'" for name in names[:limit])
    return shown if len(names) <= limit else f"{shown} and {len(names) - limit} more"


def counted(count: int, singular: str, plural: str = "") -> str:
    """The count with its noun, which takes an s in the plural unless `plural` is given."""
    return f"{count:,} {singular}" if count == 1 else f"{count:,} {plural or singular + 's'}"


def sentence(text: str) -> str:
    """The text with a capital letter first and a full stop last."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")
