# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands in processes of their own, from the folder that the zip was installed to."""

import contextlib
import io
import json
import subprocess
import sys
from pathlib import Path

import bpy
from scratch_profile import MODULE, PROFILE

FOLDER = Path(PROFILE) / "extensions" / "user_default" / "dermis"


def start(*arguments):
    """A process that runs a command."""
    command = [sys.executable, FOLDER, *arguments]
    return subprocess.Popen(
        [str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )  # fmt: skip


def end(process):
    """Exit code and output of a process."""
    output, _ = process.communicate(timeout=120)
    return process.returncode, output


def run_alone(*arguments, code=0):
    """The output of a command in a process of its own, which ends with this code."""
    status, output = end(start(*arguments))
    assert status == code, output
    return output


def run(*arguments, code=0):
    """The same in this process, as Blender's `--command` does it."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        status = module("batch.command").main([str(word) for word in arguments])
    assert status == code, output.getvalue()
    return output.getvalue()


def module(name):
    return sys.modules[f"{MODULE}.{name}"]


def save(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def opened(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.data.objects


def groups(ob):
    """Vertex groups with every weight, exactly."""
    names = [(group.name, group.lock_weight) for group in ob.vertex_groups]
    return names, [[(entry.group, entry.weight) for entry in vertex.groups] for vertex in ob.data.vertices]


def rig_of(ob):
    """What deforms the mesh, and its parent, by name."""
    return [(m.name, m.type, m.object and m.object.name) for m in ob.modifiers], ob.parent and ob.parent.name


def report(path):
    return json.loads(Path(path).read_text())
