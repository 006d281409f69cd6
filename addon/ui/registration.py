# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers everything, and takes it back in the opposite order."""

from contextlib import ExitStack

import bpy

from . import menus, panel, properties
from .landmark_add import DERMIS_OT_landmark_add
from .landmark_clear import DERMIS_OT_landmark_clear
from .landmark_remove import DERMIS_OT_landmark_remove
from .landmark_show import DERMIS_OT_landmark_show
from .retarget_weights import DERMIS_OT_retarget_weights

CLASSES = (
    DERMIS_OT_retarget_weights,
    DERMIS_OT_landmark_add,
    DERMIS_OT_landmark_remove,
    DERMIS_OT_landmark_show,
    DERMIS_OT_landmark_clear,
    *panel.CLASSES,
)

_undo = ExitStack()


def register() -> None:
    """Register all, or nothing when something fails."""
    with ExitStack() as undo:
        properties.register()
        undo.callback(properties.unregister)
        for cls in CLASSES:
            bpy.utils.register_class(cls)
            undo.callback(bpy.utils.unregister_class, cls)
        menus.register()
        undo.callback(menus.unregister)
        _undo.push(undo.pop_all())


def unregister() -> None:
    """Take everything back."""
    _undo.close()
