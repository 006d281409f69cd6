# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens files, appends objects, and saves: whole or not at all."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ..core.errors import InputError, listed, sentence
from ..core.new_files import NewFiles
from ..core.recipe import Append


def open_file(path: str, autoexec: bool) -> None:
    """Open the file, or an empty one where there is no path."""
    if not path:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        return
    if not Path(path).is_file():
        raise InputError(f"There is no file '{path}'.")
    # Without being told, Blender decides about scripts by its own switches and preferences.
    scripts = {"use_scripts": True} if autoexec else {}
    try:
        bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, **scripts)
    except RuntimeError as error:
        raise InputError(f"'{path}' cannot be opened: {sentence(str(error))}") from error


def append_objects(order: Append) -> None:
    """Append objects with all that they need, under the names that they are to have."""
    if not Path(order.file).is_file():
        raise InputError(f"There is no file '{order.file}'.")
    final = [order.rename.get(name, name) for name in order.objects]
    taken = [name for name in final if name in bpy.data.objects]
    if taken or len(set(final)) != len(final):
        raise InputError(f"{listed(taken or final)} would be there twice: rename what is appended.")
    before = set(bpy.data.objects)
    try:
        with bpy.data.libraries.load(order.file, link=False) as (there, wanted):
            missing = [name for name in order.objects if name not in there.objects]
            if not missing:
                wanted.objects = list(order.objects)
    except OSError as error:
        raise InputError(f"'{order.file}' cannot be read: {sentence(str(error))}") from error
    if missing:
        raise InputError(f"'{order.file}' has no object {listed(missing)}.")
    for ob, name in zip(wanted.objects, final, strict=True):
        ob.name = name
    for ob in sorted(set(bpy.data.objects) - before, key=lambda ob: ob.name):
        if ob.name not in bpy.context.scene.objects:
            bpy.context.scene.collection.objects.link(ob)
    bpy.context.view_layer.update()


def discard_objects(names: Sequence[str]) -> None:
    """Remove objects that nothing that stays needs."""
    objects = [bpy.data.objects.get(name) for name in names]
    missing = [name for name, ob in zip(names, objects, strict=True) if ob is None]
    if missing:
        raise InputError(f"There is no object {listed(missing)} to be discarded.")
    users = bpy.data.user_map(subset=objects)
    for ob in objects:
        needed = [user.name for user in users[ob] if isinstance(user, bpy.types.Object) and user not in objects]
        if needed:
            raise InputError(f"'{ob.name}' cannot be discarded: {listed(sorted(needed))} needs it.")
    bpy.data.batch_remove(objects)
    bpy.data.orphans_purge(do_recursive=True)


def save_file(path: str) -> None:
    """Save beside the place and rename; paths relative to the file lead where they led."""
    try:
        with NewFiles() as files:
            beside = files.add(Path(path), 0)
            bpy.ops.wm.save_as_mainfile(filepath=str(beside), copy=True, check_existing=False, relative_remap=True)
            if not beside.is_file():
                raise InputError(f"'{path}' could not be written.")
            files.commit()
    except (OSError, RuntimeError) as error:
        raise InputError(f"'{path}' could not be written: {sentence(str(error))}") from error
