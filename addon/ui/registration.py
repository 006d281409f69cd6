# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers everything, and takes it back in the opposite order."""

from contextlib import ExitStack

import bpy

from ..batch import command
from ..blender import bone_overlay, check_reports, skin_handlers
from ..core.background import end_all
from . import (
    bake_options,
    bake_panel,
    bind_panel,
    bone_map_panel,
    check_panel,
    fit_panel,
    menus,
    panel,
    properties,
    skin_panel,
    skin_properties,
)
from .bake_driven_keys import DERMIS_OT_bake_driven_keys
from .bake_join import DERMIS_OT_bake_join
from .bake_point_cache import DERMIS_OT_bake
from .bake_remove import DERMIS_OT_bake_remove
from .bake_shape_key import DERMIS_OT_bake_shape_key
from .bake_weights import DERMIS_OT_bake_weights
from .bind_weights import DERMIS_OT_bind_weights
from .bone_map_add import DERMIS_OT_bone_map_add
from .bone_map_clear import DERMIS_OT_bone_map_clear
from .bone_map_fill import DERMIS_OT_map_bones
from .bone_map_remove import DERMIS_OT_bone_map_remove
from .check_select import DERMIS_OT_select_problems
from .check_weights import DERMIS_OT_check
from .fit_skeleton import DERMIS_OT_fit_skeleton
from .landmark_add import DERMIS_OT_landmark_add
from .landmark_clear import DERMIS_OT_landmark_clear
from .landmark_remove import DERMIS_OT_landmark_remove
from .landmark_show import DERMIS_OT_landmark_show
from .retarget_weights import DERMIS_OT_retarget_weights
from .skin_disable import DERMIS_OT_skin_disable
from .skin_enable import DERMIS_OT_skin_enable

CLASSES = (
    DERMIS_OT_retarget_weights,
    DERMIS_OT_fit_skeleton,
    DERMIS_OT_bind_weights,
    DERMIS_OT_check,
    DERMIS_OT_select_problems,
    DERMIS_OT_map_bones,
    DERMIS_OT_bone_map_add,
    DERMIS_OT_bone_map_remove,
    DERMIS_OT_bone_map_clear,
    DERMIS_OT_landmark_add,
    DERMIS_OT_landmark_remove,
    DERMIS_OT_landmark_show,
    DERMIS_OT_landmark_clear,
    DERMIS_OT_skin_enable,
    DERMIS_OT_skin_disable,
    DERMIS_OT_bake,
    DERMIS_OT_bake_join,
    DERMIS_OT_bake_shape_key,
    DERMIS_OT_bake_driven_keys,
    DERMIS_OT_bake_weights,
    DERMIS_OT_bake_remove,
    *panel.CLASSES,
    *bone_map_panel.CLASSES,
    *fit_panel.CLASSES,
    *bind_panel.CLASSES,
    *check_panel.CLASSES,
    *skin_panel.CLASSES,
    *bake_panel.CLASSES,
)

_undo = ExitStack()


def register() -> None:
    """Register all, or nothing when something fails."""
    with ExitStack() as undo:
        undo.callback(end_all)
        properties.register()
        undo.callback(properties.unregister)
        skin_properties.register()
        undo.callback(skin_properties.unregister)
        bake_options.register()
        undo.callback(bake_options.unregister)
        for cls in CLASSES:
            bpy.utils.register_class(cls)
            undo.callback(bpy.utils.unregister_class, cls)
        undo.callback(check_reports.forget_reports)
        undo.callback(bone_overlay.remove_overlays)
        menus.register()
        undo.callback(menus.unregister)
        skin_handlers.register()
        undo.callback(skin_handlers.unregister)
        command.register()
        undo.callback(command.unregister)
        _undo.push(undo.pop_all())


def unregister() -> None:
    """Take everything back."""
    _undo.close()
