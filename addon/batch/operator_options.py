# SPDX-License-Identifier: GPL-3.0-or-later
"""The options of commands, read off their operators, so that names, defaults, ranges and help are the same."""

import bpy

from ..core.commands import COMMANDS, Command
from ..core.options import KINDS, Option


def command_options() -> dict[str, dict[str, Option]]:
    """Options by name for each command."""
    return {name: _options(command) for name, command in COMMANDS.items()}


def _options(command: Command) -> dict[str, Option]:
    if command.settings:
        properties = bpy.types.Object.bl_rna.properties["dermis_skin"].fixed_type.properties
    else:
        properties = getattr(bpy.ops.dermis, command.operator).get_rna_type().properties
    found = {}
    for item in properties:
        offered = item.type in KINDS and not (item.is_hidden or item.is_skip_save or item.is_readonly)
        if offered and not getattr(item, "is_array", False) and item.identifier != "name":
            found[item.identifier] = _option(item)
    return found


def _option(item: bpy.types.Property) -> Option:
    text = item.description
    if item.subtype == "ANGLE":
        text += ", in radians"
    if item.type in ("INT", "FLOAT"):
        return Option(item.identifier, item.type, item.default, text, item.hard_min, item.hard_max)
    if item.type == "ENUM":
        choices = tuple(choice.identifier for choice in item.enum_items)
        explained = "; ".join(f"{choice.identifier}: {choice.description}" for choice in item.enum_items)
        return Option(item.identifier, item.type, item.default, f"{text}. {explained}", choices=choices)
    return Option(item.identifier, item.type, item.default, text)
