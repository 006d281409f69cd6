# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of each skin that is shown, kept by the object's session id.

No reference into Blender's data is kept: undo and loading would leave it dangling. All of this can
be rebuilt from the file at any time.
"""

from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import bpy

from ..core.skin import Skin, SkinStore
from .mesh_cache import find_cache
from .placement import PlacedArmature, Placement
from .skin_reading import SkinReading


def is_live(ob: bpy.types.Object) -> bool:
    """Whether the object's skin is switched on and not baked. Of an overridden object only the cache tells it."""
    kept = ob.dermis_skin
    return kept.enabled and not kept.baked and (ob.override_library is None or find_cache(ob) is None)


@dataclass
class SkinState:
    """One object's skin.

    `written` says what the shape key holds: a signature of the pose, None when that is unknown.
    `suspect` asks for the mesh and the weights to be read again, `check_shape` and `check_armature`
    for a cheap look first. `failure` is why the last attempt to build the skin failed; it is not
    repeated until something changes. While `hold_until` lies ahead, changed settings wait for the next ones.
    """

    name: str
    reading: SkinReading | None = None
    place: Placement | None = None
    placed: PlacedArmature | None = None
    skin: Skin | None = None
    skin_key: str = ""
    configuration: tuple[Any, ...] = ()
    shape: bytes = b""
    armature: bytes = b""
    written: bytes | None = None
    suspect: bool = True
    check_shape: bool = False
    check_armature: bool = False
    hold_until: float = 0.0
    failure: str = ""
    error: str = ""
    notice: str = ""
    limited: int = 0
    milliseconds: float = 0.0
    stats: dict[str, Any] = field(default_factory=dict)

    @property
    def is_held(self) -> bool:
        """Whether a setting was changed a moment ago and may change again."""
        return monotonic() < self.hold_until


class SkinRegistry:
    """The states of all objects, and the skins themselves."""

    def __init__(self) -> None:
        self._states: dict[int, SkinState] = {}
        self._places: dict[int, tuple[str, str | None]] = {}
        self._object_count = -1
        self.store = SkinStore()

    def state(self, ob: bpy.types.Object) -> SkinState:
        """The object's state, a new one where it has none."""
        state = self._states.setdefault(ob.session_uid, SkinState(ob.name))
        state.name = ob.name
        return state

    def find(self, ob: bpy.types.Object) -> SkinState | None:
        """The object's state, if it has one."""
        return self._states.get(ob.session_uid)

    def skin(self, reading: SkinReading, key: str, placement: Placement) -> Skin:
        """The skin of a reading, built when no object has shown it lately."""
        in_use = {state.skin_key for state in self._states.values()}
        return self.store.get(key, reading.placed(placement), in_use)

    def forget(self, ob: bpy.types.Object) -> None:
        """Drop the object's state."""
        self._states.pop(ob.session_uid, None)
        self.rescan()

    def distrust(self) -> None:
        """Read everything again when it is next needed: undo may have changed anything."""
        self.rescan()
        for state in self._states.values():
            state.suspect = True
            state.written = None

    def clear(self) -> None:
        """Forget all objects; skins stay for a while."""
        self._states.clear()
        self.rescan()

    def rescan(self) -> None:
        """Look for skins among all objects when they are next needed."""
        self._object_count = -1

    def objects(self) -> list[bpy.types.Object]:
        """All objects whose skin is live."""
        found = None if self._object_count != len(bpy.data.objects) else self._known()
        if found is None:
            found = [ob for ob in bpy.data.objects if ob.type == "MESH" and is_live(ob)]
            self._places = {
                ob.session_uid: (ob.name, None if ob.library is None else ob.library.filepath) for ob in found
            }
            self._states = {uid: state for uid, state in self._states.items() if uid in self._places}
            self._object_count = len(bpy.data.objects)
        return found

    def _known(self) -> list[bpy.types.Object] | None:
        """The objects at their known places, None where one is missing there."""
        found = []
        for uid, place in self._places.items():
            ob = bpy.data.objects.get(place)
            if ob is None or ob.session_uid != uid or not is_live(ob):
                return None
            found.append(ob)
        return found


registry = SkinRegistry()
