# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be done without a window: each command is an operator with the objects that it works on."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Role:
    """Objects that a command needs, by name. The first object of the first role that is given is the active one."""

    name: str
    help: str
    several: bool = True
    required: bool = True


@dataclass(frozen=True)
class Command:
    """An operator by its name after `dermis.`.

    `settings`: its options are those of the skin, kept on the meshes. `folder`: the option that says where files
    go. `changes`: "always", "never", or the option that says whether the opened file is changed.
    """

    name: str
    operator: str
    help: str
    roles: tuple[Role, ...]
    settings: bool = False
    folder: str = ""
    changes: str = "always"
    parts: bool = False


MESHES = Role("meshes", "meshes, by name")
ARMATURE = Role("armature", "armature, by name", several=False)
OBJECTS = Role("objects", "an armature, which stands for all meshes that it deforms, or meshes, by name")

# Commands by name; another operator is one more entry.
COMMANDS = {
    command.name: command
    for command in (
        Command(
            "retarget",
            "retarget_weights",
            "give targets the weights of a source",
            (Role("source", "painted mesh, by name", several=False), Role("targets", "meshes to be weighted, by name")),
        ),
        Command("fit", "fit_skeleton", "move the bones of an armature into meshes", (ARMATURE, MESHES)),
        Command("bind", "bind_weights", "give meshes weights from an armature alone", (ARMATURE, MESHES)),
        Command("skin", "skin_enable", "switch the live PBD skin on", (OBJECTS,), settings=True),
        Command("skin-disable", "skin_disable", "switch the live PBD skin off", (OBJECTS,)),
        Command("bake", "bake", "bake point caches", (OBJECTS,), folder="directory", changes="play"),
        Command(
            "bake-join",
            "bake_join",
            "join point caches of parts of a range and play them",
            (Role("mesh", "mesh, by name", several=False),),
            folder="target",
            parts=True,
        ),
        Command("bake-driven-keys", "bake_driven_keys", "bake pose-driven shape keys", (OBJECTS,)),
        Command("bake-shape-key", "bake_shape_key", "save corrections as shape keys", (OBJECTS,)),
        Command("bake-weights", "bake_weights", "refit the weights to the skin", (OBJECTS,)),
        Command("bake-remove", "bake_remove", "go back from a bake to the live skin", (OBJECTS,)),
        Command(
            "check",
            "check",
            "look for problems of weights",
            (Role("source", "source of a dry run of retarget, by name", several=False, required=False), MESHES),
            changes="never",
        ),
    )
}
