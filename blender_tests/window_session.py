# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's session in a Blender with a window: a program that Blender runs, not a test module.

    blender --python window_session.py -- FOLDER

FOLDER holds the demo's `demo.blend`; pictures and `result.json` are left there, one entry for each step:
its name, whether it did what it should, and what it has to say. Operators start as their buttons start them,
keys are pressed by xdotool.
"""

import json
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
MODULE = "bl_ext.user_default.dermis"
PATIENCE_SECONDS = 120.0  # for a long operator on a busy machine

results = []


def said(step, good, text=""):
    results.append({"step": step, "ok": bool(good), "text": text})


def window():
    return bpy.context.window_manager.windows[0]


def view():
    return next(area for area in window().screen.areas if area.type == "VIEW_3D")


def in_view():
    area = view()
    return bpy.context.temp_override(
        window=window(), area=area, region=next(region for region in area.regions if region.type == "WINDOW")
    )


def press(name, **options):
    """What the button of an operator does."""
    group, _, operator = name.partition(".")
    with in_view():
        return getattr(getattr(bpy.ops, group), operator)("INVOKE_DEFAULT", **options)


def key(name):
    """A key pressed in the view."""
    area = view()
    x, y = area.x + area.width // 3, window().height - (area.y + area.height // 2)
    subprocess.run(["xdotool", "mousemove", str(x), str(y), "key", name], check=True)


def running():
    return [operator.bl_idname for operator in window().modal_operators]


def picture(name):
    # A region that was made again forgets its tab.
    for region in view().regions:
        if region.type == "UI" and region.active_panel_category not in ("UNSUPPORTED", "Dermis"):
            region.active_panel_category = "Dermis"
            region.tag_redraw()
    with in_view():
        bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
    # What is on the screen: Blender's own screenshot is black without a graphics card.
    subprocess.run(["import", "-window", "root", str(FOLDER / f"{name}.png")], check=True)


def choose(active, *others, mode="OBJECT"):
    with in_view():
        if bpy.context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.object.select_all(action="DESELECT")
        for ob in (*others, active):
            ob.select_set(True)
        bpy.context.view_layer.objects.active = active
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


def remember():
    """One undo step, as a user's click makes it."""
    with in_view():
        bpy.ops.ed.undo_push(message="session")


def named(name):
    # References do not outlive an undo.
    return bpy.data.objects[name]


def weight_count(ob):
    return sum(len(vertex.groups) for vertex in ob.data.vertices)


def open_panels():
    """Panels that are closed at first begin open, as if they had been clicked."""
    for name in ("landmarks", "bone_map", "check", "bake"):
        panel = getattr(bpy.types, f"DERMIS_PT_{name}")
        bpy.utils.unregister_class(panel)
        panel.bl_options = set()
        bpy.utils.register_class(panel)


def show_sidebar():
    """The sidebar's tab, in a window that shows nothing else."""
    with in_view():
        bpy.ops.screen.screen_full_area(use_hide_panels=False)
    yield 0.5
    area = view()
    area.spaces[0].show_region_ui = True
    area.spaces[0].shading.type = "SOLID"
    area.spaces[0].overlay.show_floor = area.spaces[0].overlay.show_cursor = False
    yield 1.0
    sidebar = next(region for region in view().regions if region.type == "UI")
    yield from until(lambda: sidebar.active_panel_category != "UNSUPPORTED")
    sidebar.active_panel_category = "Dermis"
    with in_view():
        bpy.ops.view3d.view_axis(type="FRONT")
        bpy.ops.view3d.view_selected(use_all_regions=False)
    yield 0.7


def until(done, seconds=PATIENCE_SECONDS):
    """Wait until something holds; the last value says whether it did."""
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        yield 0.02


def session():
    """Yields how long to let Blender run before the next step."""
    said("enabled by the command line", MODULE in bpy.context.preferences.addons)
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "demo.blend"))
    yield 1.0
    bodies = [ob for ob in bpy.data.objects if ob.type == "MESH" and ob.vertex_groups]
    source, target = (ob.name for ob in sorted(bodies, key=lambda ob: ob.parent.location.x))
    named(target).vertex_groups.clear()
    choose(named(source), named(target))
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "bare.blend"), copy=True)
    (FOLDER / "names.json").write_text(json.dumps([source, target]), encoding="utf-8")
    remember()
    open_panels()
    yield from show_sidebar()
    picture("sidebar")
    said("the demo's file is open", True, f"{source}, {target}")

    yield from retargeted(target)
    yield from landmarks(source, target)
    yield from bones(source, target)
    yield from skin(target)
    yield from fitted(target)
    yield from linked(target)
    yield from preferences()


def retargeted(target):
    said("Retarget Weights starts", press("dermis.retarget_weights") == {"RUNNING_MODAL"})
    yield 0.4
    yield from until(lambda: "DERMIS_OT_retarget_weights" not in running(), 0.6)
    picture("progress")
    start = time.monotonic()
    key("Escape")
    yield from until(lambda: not running(), 20.0)
    taken = time.monotonic() - start
    said("ESC ends it", not running(), f"{1000 * taken:.0f} ms after the key")
    said("nothing was written", weight_count(named(target)) == 0 and not named(target).vertex_groups)

    press("dermis.retarget_weights")
    longest = last = 0.0
    start = time.monotonic()
    while running() and time.monotonic() - start < PATIENCE_SECONDS:
        yield 0.01
        longest, last = max(longest, time.monotonic() - start - last), time.monotonic() - start
    said(
        "the weights are there", weight_count(named(target)) > 0, f"{last:.1f} s, longest pause {1000 * longest:.0f} ms"
    )
    picture("retargeted")
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "button.blend"), copy=True)
    written = weight_count(named(target))
    with in_view():
        bpy.ops.ed.undo()
    yield 0.5
    said("one undo takes them back", weight_count(named(target)) == 0)
    with in_view():
        bpy.ops.ed.redo()
    yield 0.5
    said("redo brings them again", weight_count(named(target)) == written)


def landmarks(source, target):
    choose(named(source), named(target), mode="EDIT")
    import bmesh

    for name in (source, target):
        mesh = bmesh.from_edit_mesh(named(name).data)
        top = max(mesh.verts, key=lambda vertex: vertex.co.z)
        for vertex in mesh.verts:
            vertex.select = vertex is top
        mesh.select_flush_mode()
        bmesh.update_edit_mesh(named(name).data)
    yield 0.3
    said("a landmark pair is added", press("dermis.landmark_add") == {"FINISHED"})
    yield 0.7
    picture("landmarks")
    choose(named(source), named(target))
    yield 0.2


def bones(source, target):
    choose(named(source), named(target))
    said(
        "the bones are listed",
        press("dermis.map_bones") == {"FINISHED"},
        f"{len(named(target).dermis_retarget.bone_map)} rows",
    )
    yield 1.0
    window().cursor_warp(400, 300)
    view().tag_redraw()
    yield 1.0
    picture("bones")


def skin(target):
    rig = named(target).parent.name
    choose(named(rig))
    yield 0.3
    started = press("dermis.skin_enable")
    said("Enable PBD Skin", started == {"FINISHED"} and named(target).dermis_skin.enabled)
    with in_view():
        bpy.context.scene.frame_set(bpy.context.scene.frame_end)
    yield 1.0
    moved = [key.value for key in named(target).data.shape_keys.key_blocks if key.name == "Dermis"]
    said("the shape key is there", moved == [1.0])
    yield 1.0
    picture("skin")
    with in_view():
        bpy.ops.screen.animation_play()
    yield 2.0
    with in_view():
        bpy.ops.screen.animation_play()
    error = sys.modules[f"{MODULE}.blender.skin_state"].registry.find(named(target)).error
    said("it plays", not error, error)
    yield 0.3
    said("Disable", press("dermis.skin_disable") == {"FINISHED"} and named(target).data.shape_keys is None)


def fitted(target):
    rig = named(target).parent.name
    with in_view():
        bpy.context.scene.frame_set(1)
    choose(named(rig), named(target))
    yield 0.3
    before = [bone.head_local.copy() for bone in named(rig).data.bones]

    def moved():
        bones = named(rig).data.bones
        return max((bone.head_local - old).length for bone, old in zip(bones, before, strict=True))

    press("dermis.fit_skeleton")
    status = sys.modules[f"{MODULE}.blender.bone_overlay"]._shown
    yield from until(lambda: bool(status) or not running())
    yield 0.5
    picture("fit")
    said("the fit shows a preview", bool(status) and moved() == 0)
    key("Return")
    yield from until(lambda: not running(), 20.0)
    said("Enter applies it", moved() > 0, f"a joint moved by up to {moved():.3f} m")
    with in_view():
        bpy.ops.ed.undo()
    yield 0.5
    said("one undo takes it back", moved() < 1e-6)


def linked(target):
    """A character that lives in another file: what the panel says, and its way."""
    rig = named(target).parent.name
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "library.blend"), copy=True)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    yield 1.0
    with bpy.data.libraries.load(str(FOLDER / "library.blend"), link=True) as (_, wanted):
        wanted.objects = [rig, target]
    for ob in wanted.objects:
        bpy.context.scene.collection.objects.link(ob)
    bpy.context.scene.frame_end = 12
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "shot.blend"))
    choose(named(rig), named(target))
    yield from show_sidebar()
    picture("linked")
    told = refused("dermis.skin_enable")
    said("a linked character is told its way", "Library Override" in told and "Bake Point Cache" in told, told)
    with in_view():
        bpy.ops.object.make_override_library()
    yield 0.5
    ours = {ob.type: ob.name for ob in bpy.data.objects if ob.override_library is not None}
    said("it is overridden", set(ours) == {"ARMATURE", "MESH"})
    choose(named(ours["ARMATURE"]))
    remember()
    yield 0.3
    told = refused("dermis.skin_enable")
    said("an override is told its way", "Bake Point Cache" in told, told)
    started = press("dermis.bake")
    yield from until(lambda: not running())
    yield 0.5
    kinds = [modifier.type for modifier in named(ours["MESH"]).modifiers]
    said("its bake plays", "MESH_CACHE" in kinds, f"{started} {kinds}")
    picture("override")
    with in_view():
        bpy.ops.ed.undo()
    yield 0.5
    kinds = [modifier.type for modifier in named(ours["MESH"]).modifiers]
    said("one undo takes the modifier away", kinds == ["ARMATURE"])


def refused(name):
    """What an operator says that does nothing."""
    try:
        press(name)
    except RuntimeError as error:
        return " ".join(str(error).split())
    return ""


def preferences():
    bpy.context.preferences.active_section = "EXTENSIONS"
    with in_view():
        bpy.ops.screen.userpref_show("INVOKE_DEFAULT")
    yield 2.0
    picture("preferences")
    said("the preferences open", len(bpy.context.window_manager.windows) == 2)
    bpy.ops.preferences.addon_disable(module=MODULE)
    said("disabled", not hasattr(bpy.types, "DERMIS_OT_retarget_weights"))
    bpy.ops.preferences.addon_enable(module=MODULE)
    said("enabled again", hasattr(bpy.types, "DERMIS_OT_retarget_weights"))


_session = session()


def step():
    """Called by Blender's timer."""
    try:
        return next(_session)
    except StopIteration:
        said("the session came to its end", True)
    except Exception:  # noqa: BLE001  (whatever it is, it is told outside)
        said("the session came to its end", False, traceback.format_exc())
    (FOLDER / "result.json").write_text(json.dumps(results, indent=2), encoding="utf-8")
    bpy.ops.wm.quit_blender()
    return None


bpy.app.timers.register(step, first_interval=1.5, persistent=True)
