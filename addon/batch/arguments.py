# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: a subcommand for each command, with its operator's options, and one for recipes."""

import argparse
from collections.abc import Mapping
from typing import Any

from ..core.commands import COMMANDS, Command
from ..core.options import Option

TYPES = {"INT": int, "FLOAT": float, "STRING": str, "ENUM": str}
# Flags that every command has; an operator's option of such a name gets the command's name before it.
OWN_FLAGS = ("file", "output", "report", "enable_autoexec", "parts")
SHORT = {"frame_start": "-s", "frame_end": "-e"}
# Where argparse keeps an option: no flag of ours starts like this.
PREFIX = "option:"
EXIT_CODES = (
    "exit codes: 0 done, 1 something failed and was not written, 2 wrong usage or recipe, 3 done, and a check found "
    "problems"
)


def parser(prog: str, known: Mapping[str, Mapping[str, Option]]) -> argparse.ArgumentParser:
    """The parser; `known` has the options of each command."""
    top = argparse.ArgumentParser(prog=prog, description=__doc__, epilog=EXIT_CODES, allow_abbrev=False)
    top.description = "Dermis without a window."
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS.values():
        sub = commands.add_parser(command.name, help=command.help, epilog=EXIT_CODES, allow_abbrev=False)
        sub.description = f"{command.help[0].upper()}{command.help[1:]}."
        _add_command(sub, command, known[command.name])
    run = commands.add_parser("run", help="run a recipe", epilog=EXIT_CODES, allow_abbrev=False)
    run.description = "Run a recipe: a JSON file that says what is done to which files."
    run.add_argument("recipe", metavar="RECIPE.json", help="the recipe; its paths are relative to its folder")
    run.add_argument("--job", action="append", default=[], metavar="NAME", help="run this job alone; repeatable")
    run.add_argument("--dask", default="", metavar="ADDRESS", help="let workers of this Dask scheduler run the jobs")
    run.add_argument("--list", action="store_true", help="print the names of the jobs and end")
    _add_common(run)
    return top


def step_data(command: Command, found: argparse.Namespace) -> dict[str, Any]:
    """What was given, in the form of a recipe's step."""
    values = vars(found)
    data: dict[str, Any] = {"command": command.name}
    for key in [role.name for role in command.roles] + (["parts"] if command.parts else []):
        if values[key] is not None:
            data[key] = values[key]
    data["options"] = {key.removeprefix(PREFIX): value for key, value in values.items() if key.startswith(PREFIX)}
    return data


def _add_command(sub: argparse.ArgumentParser, command: Command, options: Mapping[str, Option]) -> None:
    sub.add_argument("--file", required=True, metavar="IN.blend", help="the file to open")
    wanted = "" if command.changes == "always" else "; not needed where nothing in the file changes"
    sub.add_argument("--output", default="", metavar="OUT.blend", help=f"where to save the result{wanted}")
    for role in command.roles:
        number = "+" if role.several else None
        sub.add_argument(f"--{role.name}", required=role.required, nargs=number, metavar="NAME", help=role.help)
    if command.parts:
        sub.add_argument("--parts", required=True, nargs="+", metavar="FILE", help="the caches of the parts")
    _add_common(sub)
    group = sub.add_argument_group("options of the operator" if not command.settings else "settings of the skin")
    taken = {*OWN_FLAGS, *(role.name for role in command.roles)}
    for option in options.values():
        _add_option(group, option, f"{command.name}-" if option.name in taken else "")


def _add_option(group: Any, option: Option, before: str) -> None:
    """A flag; what is not given stays out of the namespace, so that Blender's own default holds."""
    flags = [f"--{before}{option.name.replace('_', '-')}"]
    if option.name in SHORT:
        flags.insert(0, SHORT[option.name])
    default = f"{option.default:g}" if option.kind == "FLOAT" else option.default
    text = f"{option.help} (default: {default if default != '' else 'empty'})".replace("%", "%%")
    settings: dict[str, Any] = {"dest": PREFIX + option.name, "default": argparse.SUPPRESS, "help": text}
    if option.kind == "BOOLEAN":
        group.add_argument(*flags, action=argparse.BooleanOptionalAction, **settings)
    elif option.kind == "ENUM":
        group.add_argument(*flags, choices=option.choices, **settings)
    else:
        group.add_argument(*flags, type=TYPES[option.kind], metavar=option.kind, **settings)


def _add_common(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--report", default="", metavar="REPORT.json", help="write what was done as JSON")
    sub.add_argument("--enable-autoexec", action="store_true", help="let Python scripts and drivers of the files run")
