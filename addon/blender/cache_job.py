# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake of point caches: read the poses, write the files, let modifiers play them."""

import re
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import bpy

from ..core.bake_task import CacheOrder, CacheTask
from ..core.errors import InputError, counted, listed
from ..core.frame_range import FrameRange
from ..core.point_cache import SUFFIXES, CacheFormat
from .bake_source import BakeSource
from .bake_state import back_to_live, is_baked, switch_off
from .frame_walk import FrameWalk
from .mesh_cache import MODIFIER_NAME, add_cache
from .sampled_task import SampledTask
from .skin_state import registry


class CacheJob:
    """Reads and checks everything in the constructor; `finish` changes the scene."""

    def __init__(
        self,
        objects: Sequence[bpy.types.Object],
        scene: bpy.types.Scene,
        frames: FrameRange,
        folder: str,
        kind: CacheFormat,
        *,
        play: bool = True,
        scheduler: str = "",
    ) -> None:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        self._scene, self._frames, self._kind, self._play = scene, frames, kind, play
        self._scheduler = scheduler.strip()
        self._fps = scene.render.fps / scene.render.fps_base
        for ob in objects:
            check_own(ob)
        self._filepaths = cache_paths(objects, folder, kind)
        self._sources = [BakeSource(ob, depsgraph) for ob in objects]
        armatures = {source.armature.name_full: source.armature for source in self._sources}
        self.task = SampledTask(FrameWalk(scene, frames, list(armatures.values()), self._read), self._write)

    def _read(self, depsgraph: bpy.types.Depsgraph) -> None:
        for source in self._sources:
            source.read(depsgraph)

    def _write(self) -> CacheTask:
        orders = [
            CacheOrder(Path(bpy.path.abspath(filepath)), source.frames(), source.samples)
            for filepath, source in zip(self._filepaths, self._sources, strict=True)
        ]
        return CacheTask(orders, self._frames, self._kind, self._fps, self._scheduler)

    def finish(self) -> str:
        """Let modifiers play the files in the place of the live skins; one line about them."""
        sizes = self.task.result()
        try:
            if self._play:
                with ExitStack() as undo:
                    for source, filepath in zip(self._sources, self._filepaths, strict=True):
                        undo.callback(back_to_live, [source.ob])
                        add_cache(source.ob, source.modifier, filepath, self._kind, self._frames, self._scene)
                        if source.is_live:
                            switch_off(source.ob, "CACHE")
                        registry.forget(source.ob)
                    undo.pop_all()
        except ReferenceError as error:
            raise InputError("A mesh was removed while it was being baked; its cache is written.") from error
        names = listed([source.name for source in self._sources])
        return (
            f"Baked {counted(len(self._frames), 'sample')} of {names}: "
            f"{counted(len(sizes), 'file')}, {sum(sizes) / 1e6:.1f} MB."
        )


def check_own(ob: bpy.types.Object) -> None:
    """Raise InputError where no modifier can be added or one is there already."""
    if ob.library is not None:
        raise InputError(
            f"'{ob.name}' is linked from '{ob.library.filepath}' and cannot get a modifier here: "
            "use Object > Library Override > Make first."
        )
    if is_baked(ob):
        raise InputError(f"'{ob.name}' is baked already: use Back to Live first.")
    if MODIFIER_NAME in ob.modifiers:
        raise InputError(f"'{ob.name}' has another modifier named '{MODIFIER_NAME}': rename it.")


def cache_paths(objects: Sequence[bpy.types.Object], folder: str, kind: CacheFormat) -> list[str]:
    """A file in the folder for each object, after the names of the .blend file and of the object."""
    if not folder.strip():
        raise InputError("Choose a folder for the cache.")
    if folder.startswith("//") and not bpy.data.filepath:
        raise InputError(
            "Save the file first, or choose an absolute folder: '//' stands for the folder of the saved file."
        )
    start = Path(bpy.data.filepath).stem + "_" if bpy.data.filepath else ""
    taken: set[str] = set()
    paths = []
    for ob in objects:
        clean = re.sub(r'[<>:"/\\|?*\x00-\x1f]', "_", start + ob.name)
        name, number = clean, 1
        while name.casefold() in taken:
            number += 1
            name = f"{clean}_{number}"
        taken.add(name.casefold())
        between = "" if folder.endswith(("/", "\\")) else "/"
        paths.append(folder + between + name + SUFFIXES[kind])
    return paths
