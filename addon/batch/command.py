# SPDX-License-Identifier: GPL-3.0-or-later
"""What `blender --command dermis` and `python -m` do: read the arguments, run the jobs, report, exit code."""

import argparse
import json
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import bpy

from ..core.commands import COMMANDS
from ..core.errors import InputError, listed
from ..core.native import manifest_version
from ..core.new_files import NewFiles
from ..core.recipe import Job, read_recipe, read_step
from .arguments import parser, step_data
from .job import run_jobs, say
from .operator_options import command_options
from .spread import spread_jobs
from .step import FAILED, PROBLEMS

NAME = "dermis"
EXIT_DONE, EXIT_FAILED, EXIT_USAGE, EXIT_PROBLEMS = 0, 1, 2, 3

_undo = ExitStack()


def main(arguments: Sequence[str], prog: str = f"blender --command {NAME}") -> int:
    """Run a command or a recipe; the exit code."""
    known = command_options()
    reader = parser(prog, known)
    try:
        found = reader.parse_args(arguments)
        try:
            jobs = _recipe_jobs(found, known) if found.command == "run" else [_single_job(found, known)]
        except InputError as error:
            reader.error(str(error))
    except SystemExit as end:
        # argparse ends so, for its help as well as for errors.
        return int(end.code or 0)
    if found.command == "run" and found.list:
        print("\n".join(job.name for job in jobs), flush=True)
        return EXIT_DONE
    try:
        if found.command == "run" and found.dask:
            flags = ("--enable-autoexec",) if found.enable_autoexec else ()
            entries = spread_jobs(found.dask, Path(found.recipe).absolute(), jobs, flags)
        else:
            entries = run_jobs(jobs, found.enable_autoexec)
    except InputError as error:
        say(f"error: {error}")
        return EXIT_FAILED
    except KeyboardInterrupt:
        say("stopped; what was not saved yet is not written")
        return EXIT_FAILED
    states = {entry["status"] for entry in entries}
    code = EXIT_FAILED if FAILED in states else EXIT_PROBLEMS if PROBLEMS in states else EXIT_DONE
    if found.report:
        try:
            _write_report(Path(found.report), {"version": manifest_version(), "exit_code": code, "jobs": entries})
        except (InputError, OSError) as error:
            say(f"error: the report was not written: {error}")
            return EXIT_FAILED
    return code


def _single_job(found: argparse.Namespace, known: dict[str, Any]) -> Job:
    """A command as a job of one step."""
    command = COMMANDS[found.command]
    data = step_data(command, found)
    if command.parts:
        data["parts"] = [str(Path(part).absolute()) for part in data["parts"]]
    step = read_step(data, known, found.command)
    if step.changes and not found.output:
        raise InputError(f"{found.command} changes the file: say with --output where to save it.")
    output = str(Path(found.output).absolute()) if found.output else ""
    return Job(found.command, str(Path(found.file).absolute()), (), (step,), (), output)


def _recipe_jobs(found: argparse.Namespace, known: dict[str, Any]) -> list[Job]:
    """The jobs of a recipe that are asked for."""
    path = Path(found.recipe).absolute()
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"The recipe '{path}' cannot be read: {error}.") from error
    jobs = read_recipe(text, path.parent, known)
    missing = [name for name in found.job if name not in {job.name for job in jobs}]
    if missing:
        raise InputError(f"The recipe has no job {listed(missing)}; --list shows all.")
    return [job for job in jobs if not found.job or job.name in found.job]


def _write_report(place: Path, report: dict[str, Any]) -> None:
    content = json.dumps(report, indent=1) + "\n"
    with NewFiles() as files:
        files.add(place.absolute(), len(content)).write_text(content, encoding="utf-8")
        files.commit()


def register() -> None:
    """Offer the command to Blender's `--command`."""
    _undo.callback(bpy.utils.unregister_cli_command, bpy.utils.register_cli_command(NAME, main))


def unregister() -> None:
    """Take it back."""
    _undo.close()
