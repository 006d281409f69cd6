# SPDX-License-Identifier: GPL-3.0-or-later
"""One stage in the life of an installed zip, in a Blender of its own: a program, not a test module.

    DERMIS_PROFILE=FOLDER python install_cycle.py STAGE ZIP

The stages use one profile, in this order: `first` installs a zip of an older version, `upgrade` puts this one
over it while the old library is loaded, `use` starts anew, `remove` takes everything away; `foreign` is offered
a zip for another system. Each says that it is ok as its last word, or raises.
"""

import os
import sys
import traceback
from pathlib import Path

from scratch_profile import MODULE, PROFILE  # isort: skip  (before bpy)
from profile_modules import OnlyFromTheProfile  # isort: skip

import bpy
import characters as c

STAGE, ZIP = sys.argv[1:3]
OLD = "0.0.1"


def enabled():
    return MODULE in bpy.context.preferences.addons


def works():
    return hasattr(bpy.types, "DERMIS_OT_retarget_weights")


def install():
    status = bpy.ops.extensions.package_install_files(
        filepath=ZIP, repo="user_default", enable_on_install=True, overwrite=True
    )
    assert status == {"FINISHED"}, status
    bpy.ops.wm.save_userpref()


def handlers():
    """Functions of the add-on that Blender would still call."""
    lists = [getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)]
    return [each for found in lists if isinstance(found, list) for each in found if each.__module__.startswith(MODULE)]


def retarget():
    """The real operator on two small bodies; every vertex must get weights that sum to 1."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    source, _ = c.source_tube()
    target = c.target_tube()
    c.activate(source, target)
    bpy.context.view_layer.update()
    assert bpy.ops.dermis.retarget_weights() == {"FINISHED"}
    totals = [sum(group.weight for group in vertex.groups) for vertex in target.data.vertices]
    assert len(totals) > 0
    assert max(abs(total - 1) for total in totals) < 1e-5


def first():
    """An older version, enabled at once."""
    install()
    assert enabled()
    import dermis_native

    assert dermis_native.__version__ == OLD


def upgrade():
    """The old library cannot be replaced while it is loaded: the panel says so."""
    bpy.ops.preferences.addon_enable(module=MODULE)
    assert (enabled(), works()) == (True, False)
    install()
    assert (enabled(), works()) == (True, False)
    lines = " ".join(sys.modules[f"{MODULE}.ui.missing_native"]._lines)
    assert f"found the native module {OLD}. Restart Blender" in lines


def use():
    """After the restart: it works, goes away without a trace when it is disabled, and comes back."""
    bpy.ops.preferences.addon_enable(module=MODULE)
    assert works()
    import dermis_native

    assert dermis_native.__file__.startswith(PROFILE)
    assert dermis_native.__version__ != OLD
    retarget()
    bpy.ops.preferences.addon_disable(module=MODULE)
    assert (enabled(), works(), handlers()) == (False, False, [])
    bpy.ops.preferences.addon_enable(module=MODULE)
    retarget()
    install()
    assert works(), "the same version over itself needs no restart"
    retarget()


def remove():
    """Nothing of it stays in the profile."""
    repos = [repo.module for repo in bpy.context.preferences.extensions.repos]
    status = bpy.ops.extensions.package_uninstall(repo_index=repos.index("user_default"), pkg_id="dermis")
    assert status == {"FINISHED"}, status
    left = [str(path) for path in Path(PROFILE).rglob("*dermis*")]
    assert left == [], left


def foreign():
    """A zip for another system does nothing, whatever Blender says of it."""
    try:
        bpy.ops.extensions.package_install_files(
            filepath=ZIP, repo="user_default", enable_on_install=True, overwrite=True
        )
    except RuntimeError as error:
        print(error)
    assert (enabled(), works()) == (False, False)


sys.meta_path.insert(0, OnlyFromTheProfile)
status = 1
try:
    {each.__name__: each for each in (first, upgrade, use, remove, foreign)}[STAGE]()
    print(f"Blender {bpy.app.version_string}, Python {sys.version.split()[0]}: {STAGE} ok", flush=True)
    status = 0
finally:
    if status:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender as a module may hang at its own exit while an add-on is enabled.
    os._exit(status)
