# SPDX-License-Identifier: GPL-3.0-or-later
"""Tells whether the native module can be used, before anything imports it."""

import importlib
import tomllib
from pathlib import Path

MANIFEST = Path(__file__).resolve().parent.parent / "blender_manifest.toml"


def manifest_version() -> str:
    """Version of this add-on, as its manifest gives it."""
    with MANIFEST.open("rb") as file:
        return str(tomllib.load(file)["version"])


def native_problem(module_name: str = "dermis_native") -> list[str]:
    """Why the native module cannot be used, as short lines for a panel; empty when all is well."""
    version = manifest_version()
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        return [
            "The native module could not be loaded.",
            "Install the Dermis zip made for this system",
            "and this version of Blender.",
            f"Reason: {error}",
        ]
    found = str(getattr(module, "__version__", "unknown"))
    if found != version:
        return [
            f"Dermis {version} found the native module {found}.",
            "Restart Blender to finish the upgrade; if this stays,",
            "remove Dermis and install its zip again.",
        ]
    return []
