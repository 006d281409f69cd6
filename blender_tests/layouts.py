# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels drawn into a stand-in, which checks every name that they use."""

import bpy


class Options:
    """Stands in for an operator's options in a layout: takes those that the operator has."""

    def __init__(self, properties):
        vars(self)["properties"] = properties

    def __setattr__(self, name, value):
        prop = self.properties[name]
        assert prop.type != "ENUM" or value in prop.enum_items, value


class Layout:
    """Stands in for a panel's layout: takes every call, and checks what it names."""

    def __init__(self, drawn):
        self.drawn = drawn

    def __setattr__(self, name, value):
        if name != "drawn":
            assert name in bpy.types.UILayout.bl_rna.properties, name
        super().__setattr__(name, value)

    def _nested(self, **_):
        return Layout(self.drawn)

    row = column = split = box = _nested

    def separator(self):
        self.drawn.append("separator")

    def label(self, text="", icon="NONE"):
        assert icon in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
        self.drawn.append(text or icon)

    def prop(self, data, name, **_):
        assert name in data.bl_rna.properties or name in data.__annotations__
        self.drawn.append(name)

    def operator(self, name, icon="NONE", **_):
        """Record the operator; what is returned takes its options and checks that it has them."""
        group, _, operator = name.partition(".")
        getattr(getattr(bpy.ops, group), operator).get_rna_type()
        assert icon in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
        self.drawn.append(name)
        return Options(getattr(getattr(bpy.ops, group), operator).get_rna_type().properties)

    def prop_search(self, data, name, search_data, search_name, **_):
        assert name in data.bl_rna.properties
        assert search_name in search_data.bl_rna.properties
        self.drawn.append(name)

    def template_list(self, kind, _id, data, name, active, active_name, **_):
        assert hasattr(bpy.types, kind)
        assert name in data.bl_rna.properties
        assert active_name in active.bl_rna.properties
        self.drawn.append(kind)


class Drawn:
    """A panel, menu or list that draws into a stand-in."""

    def __init__(self):
        self.layout = Layout([])


def draw(panel):
    stand_in = Drawn()
    getattr(bpy.types, panel).draw(stand_in, bpy.context)
    return stand_in.layout.drawn
