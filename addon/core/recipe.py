# SPDX-License-Identifier: GPL-3.0-or-later
"""Recipes: JSON files that say what is done to which files, for every combination of some variables."""

from __future__ import annotations

import itertools
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .commands import COMMANDS, Command
from .errors import InputError, listed
from .options import Option, check_options, unknown
from .schema import no_twice, read_record

VERSION = 1
PLACEHOLDER = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True)
class Append:
    """Objects to be appended from another file, with what they need; `rename` gives some other names."""

    file: str
    objects: tuple[str, ...]
    rename: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Recipe:
    """What the JSON holds. Texts may name variables in braces; `open` is empty for an empty scene."""

    version: int
    steps: tuple[dict[str, Any], ...]
    for_each: dict[str, tuple[str, ...]] = field(default_factory=dict)
    open: str = ""
    append: tuple[Append, ...] = ()
    discard: tuple[str, ...] = ()
    output: str = ""


@dataclass(frozen=True)
class Step:
    """A command with the objects of its roles, its options, and for joining the files of the parts."""

    command: Command
    objects: dict[str, tuple[str, ...]]
    options: dict[str, Any]
    parts: tuple[str, ...] = ()

    @property
    def changes(self) -> bool:
        """Whether there is anything to be saved afterwards."""
        if self.command.changes == "play":
            return bool(self.options.get("play", True))
        return self.command.changes == "always"


@dataclass(frozen=True)
class Job:
    """One combination of the variables: open, append, steps, save. Paths are absolute; none is empty text."""

    name: str
    open: str
    append: tuple[Append, ...]
    steps: tuple[Step, ...]
    discard: tuple[str, ...]
    output: str


def read_recipe(text: str, folder: Path, known: Mapping[str, Mapping[str, Option]]) -> list[Job]:
    """All jobs of a recipe, whose paths are relative to `folder`; `known` has the options of each command.

    Everything that can be wrong without opening a file is an InputError that names its place.
    """
    try:
        data = json.loads(text, object_pairs_hook=no_twice)
    except json.JSONDecodeError as error:
        raise InputError(f"The recipe is not JSON: line {error.lineno}, column {error.colno}: {error.msg}.") from error
    recipe = read_record(Recipe, data, "recipe")
    if recipe.version != VERSION:
        raise InputError(f"recipe.version is {recipe.version}; this Dermis reads version {VERSION}.")
    if not recipe.steps:
        raise InputError("recipe.steps is empty.")
    for name, values in recipe.for_each.items():
        if not name.isidentifier():
            raise InputError(f"recipe.for_each: '{name}' is no name of a variable.")
        if not values or len(set(values)) != len(values):
            raise InputError(f"recipe.for_each.{name} must have values, each of them once.")
    jobs = [_job(recipe, folder, dict(zip(recipe.for_each, values, strict=True)), known)
            for values in itertools.product(*recipe.for_each.values())]  # fmt: skip
    check_places(jobs)
    return jobs


def read_step(data: Any, known: Mapping[str, Mapping[str, Option]], place: str) -> Step:
    """A step: "command", the names of the objects by role, "options", and "parts" where there are some."""
    if not isinstance(data, dict) or not isinstance(data.get("command"), str):
        raise InputError(f"{place} must be an object with the name of a 'command'.")
    if data["command"] not in COMMANDS:
        raise InputError(unknown(data["command"], COMMANDS, "command", place))
    command = COMMANDS[data["command"]]
    roles = {role.name: role for role in command.roles}
    allowed = {"command": None, **roles, "options": None, **({"parts": None} if command.parts else {})}
    for key in data:
        if key not in allowed:
            raise InputError(unknown(key, allowed, "key", place))
    objects = {}
    for role in command.roles:
        if role.name in data:
            objects[role.name] = _names(data[role.name], role.several, f"{place}.{role.name}")
        elif role.required:
            raise InputError(f"{place} lacks '{role.name}': {role.help}.")
    parts = _names(data["parts"], True, f"{place}.parts") if "parts" in data else ()
    if command.parts and not parts:
        raise InputError(f"{place} lacks 'parts': the files to be joined.")
    options = data.get("options", {})
    if not isinstance(options, dict):
        raise InputError(f"{place}.options must be an object.")
    if "source" in objects and "use_retarget" in known[command.name]:
        options = {"use_retarget": True, **options}
    return Step(command, objects, check_options(known[command.name], options, f"{place}.options"), parts)


def check_places(jobs: list[Job]) -> None:
    """Raise InputError where two jobs would write one file, or one would write what another reads."""
    outputs: dict[str, str] = {}
    inputs = {path for job in jobs for path in (job.open, *(item.file for item in job.append)) if len(jobs) > 1}
    caches: dict[tuple[Any, ...], str] = {}
    for job in jobs:
        if job.output and outputs.setdefault(job.output, job.name) != job.name:
            raise InputError(
                f"recipe.output: '{outputs[job.output]}' and '{job.name}' would both write '{job.output}': "
                "name the variables in it."
            )
        if job.output in inputs - {""}:
            raise InputError(f"recipe.output: '{job.name}' would write '{job.output}', which jobs read.")
        for number, step in enumerate(job.steps):
            if not step.command.folder:
                continue
            folder = step.options.get(step.command.folder) or "//"
            # Caches are named after the opened file and the object.
            named = job.open if folder.startswith("//") else Path(job.open).stem
            frames = (step.options.get("frame_start"), step.options.get("file_format"))
            key = (named, step.command.name, folder, *sorted(step.objects.items()), frames)
            if caches.setdefault(key, job.name) != job.name:
                raise InputError(
                    f"recipe.steps[{number}]: '{caches[key]}' and '{job.name}' would both bake into the folder "
                    f"'{folder}': name the variables in the option '{step.command.folder}'."
                )


def _job(
    recipe: Recipe, folder: Path, variables: dict[str, str], known: Mapping[str, Mapping[str, Option]]
) -> Job:  # fmt: skip
    """One combination, with its variables put in."""

    def path(text: str, place: str) -> str:
        filled = fill(text, variables, place)
        return os.path.normpath(folder / filled) if filled else ""

    steps = tuple(
        read_step(fill(step, variables, f"recipe.steps[{number}]"), known, f"recipe.steps[{number}]")
        for number, step in enumerate(recipe.steps)
    )
    steps = tuple(
        Step(step.command, step.objects, step.options, tuple(os.path.normpath(folder / part) for part in step.parts))
        for step in steps
    )
    appended = []
    for number, item in enumerate(recipe.append):
        place = f"recipe.append[{number}]"
        names = tuple(fill(list(item.objects), variables, place))
        rename = fill(item.rename, variables, place)
        lost = [name for name in rename if name not in names]
        if lost:
            raise InputError(f"{place}.rename has {listed(lost)}, which its objects lack.")
        appended.append(Append(path(item.file, place), names, rename))
    output = path(recipe.output, "recipe.output")
    if not output and any(step.changes for step in steps):
        raise InputError("recipe lacks 'output': its steps change the file, and it would not be saved.")
    if not recipe.open and not recipe.append:
        raise InputError("recipe lacks 'open' or 'append': there is nothing to work on.")
    discard = tuple(fill(list(recipe.discard), variables, "recipe.discard"))
    name = ",".join(f"{key}={value}" for key, value in variables.items()) or "recipe"
    return Job(name, path(recipe.open, "recipe.open"), tuple(appended), steps, discard, output)


def fill(value: Any, variables: Mapping[str, str], place: str) -> Any:
    """The value with the variables put in for their names in braces, in all texts and keys that it has."""
    if isinstance(value, str):

        def put(match: re.Match[str]) -> str:
            if match[1] not in variables:
                raise InputError(unknown(match[1], variables, "variable", place))
            return variables[match[1]]

        return PLACEHOLDER.sub(put, value)
    if isinstance(value, list):
        return [fill(item, variables, f"{place}[{number}]") for number, item in enumerate(value)]
    if isinstance(value, dict):
        return {fill(key, variables, place): fill(item, variables, f"{place}.{key}") for key, item in value.items()}
    return value


def _names(value: Any, several: bool, place: str) -> tuple[str, ...]:
    """A name, or a list of names without repetition."""
    names = value if isinstance(value, list) else [value]
    if not names or not all(isinstance(name, str) and name for name in names):
        raise InputError(f"{place} must be a name" + (" or a list of names." if several else "."))
    if not several and len(names) > 1:
        raise InputError(f"{place} must be a single name.")
    if len(set(names)) != len(names):
        raise InputError(f"{place} names an object twice.")
    return tuple(names)
