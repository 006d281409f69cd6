# SPDX-License-Identifier: GPL-3.0-or-later
"""The moments at which skins are brought up to date: frames, edits, undo, files, renders."""

from contextlib import contextmanager
from threading import RLock

import bpy
from bpy.app.handlers import persistent

from .skin_state import is_live, registry
from .skin_update import update_skin

# A render started from a window calls handlers on a thread of its own.
_lock = RLock()
_busy = False


@contextmanager
def _alone():
    """Whether to go on: never inside a handler that is at work already."""
    global _busy
    with _lock:
        if _busy:
            yield False
            return
        _busy = True
        try:
            yield True
        finally:
            _busy = False


@contextmanager
def paused():
    """Let frames pass without solving them: for what only reads poses."""
    with _alone():
        yield


@persistent
def on_frame(_scene, depsgraph):
    """A frame or subframe was evaluated, for the viewport or for a render."""
    with _alone() as go:
        if go:
            for ob in registry.objects():
                update_skin(ob, depsgraph)


@persistent
def on_update(_scene, depsgraph):
    """Something was edited: note what skins depend on, then bring them up to date."""
    with _alone() as go:
        if not go:
            return
        edited, shapes, armatures, unknown = set(), set(), set(), False
        for update in depsgraph.updates:
            id_data = update.id
            if isinstance(id_data, bpy.types.Mesh):
                # An edit tags shading too; what only follows from shape keys does not.
                (edited if update.is_updated_shading else shapes).add(id_data.original.name_full)
            elif isinstance(id_data, bpy.types.Armature):
                armatures.add(id_data.original.name_full)
            elif isinstance(id_data, bpy.types.Object) and id_data.type == "MESH" and is_live(id_data):
                unknown |= registry.find(id_data.original) is None
        if unknown:
            registry.rescan()
        for ob in registry.objects():
            state = registry.state(ob)
            state.suspect |= ob.data.name_full in edited
            state.check_shape |= ob.data.name_full in shapes
            state.check_armature |= bool(armatures)
            update_skin(ob, depsgraph)


@persistent
def on_load(*_):
    """Another file is open: its objects are others."""
    with _lock:
        registry.clear()


@persistent
def on_undo(*_):
    """Undo or redo has put other data in place; the evaluation that follows writes the shape keys."""
    with _lock:
        registry.distrust()


@persistent
def on_render_end(*_):
    """After a render the shape keys hold its last frame: let the scene's own frame be written again."""
    with _lock:
        for ob in registry.objects():
            ob.update_tag(refresh={"OBJECT"})


_HANDLERS = (
    ("frame_change_post", on_frame),
    ("depsgraph_update_post", on_update),
    ("load_post", on_load),
    ("undo_post", on_undo),
    ("redo_post", on_undo),
    ("render_complete", on_render_end),
    ("render_cancel", on_render_end),
)


def register() -> None:
    """Hook in."""
    registry.clear()
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Take the hooks out and free the skins; shape keys stay as they are."""
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    registry.clear()
    registry.store.clear()
