"""Imports go one way: ui -> batch -> blender -> core -> dermis_native, and in the core down the paper's sections."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from checkout import ROOT, relative, shipped_files

CORE = ROOT / "native" / "core" / "src"
ADDON = ROOT / "addon"

# Folders of the Rust core; a folder may import its own layer and lower ones, never in a circle.
RUST_LAYERS = {
    **dict.fromkeys(["mesh", "linalg"], 0),
    **dict.fromkeys(["skinning", "cage", "spectral"], 1),
    **dict.fromkeys(["pbd", "retarget", "rig"], 2),
}
ADDON_LAYERS = {"core": 0, "blender": 1, "batch": 2, "ui": 3}
BLENDER_MODULES = {"bpy", "bmesh", "mathutils", "gpu", "bl_math", "blf", "addon_utils", "bpy_extras"}


def without_comments(text: str) -> str:
    return re.sub(r"/\*.*?\*/|//[^\n]*", "", text, flags=re.DOTALL)


def group_heads(text: str, start: int) -> list[str]:
    """First path segment of each item of a `{...}` group whose opening brace is at `start`."""
    heads, depth, item = [], 0, ""
    for character in text[start:]:
        depth += {"{": 1, "}": -1}.get(character, 0)
        if (character == "," and depth == 1) or depth == 0:
            heads.append(item.strip().split("::")[0])
            item = ""
            if depth == 0:
                break
        elif not (character == "{" and depth == 1):
            item += character
    return [head for head in heads if head]


def crate_modules(text: str, supers_to_root: int) -> set[str]:
    """Top-level modules of the crate that a file names, by `crate::` or by `super::` up to the root."""
    root = rf"\b(?:crate|super(?:::super){{{supers_to_root - 1}}})::"
    code = without_comments(text)
    found = set(re.findall(root + r"(\w+)", code))
    for group in re.finditer(root + r"\{", code):
        found.update(group_heads(code, group.end() - 1))
    return found


def rust_imports() -> dict[str, set[str]]:
    """Folders of the core that each folder's files import."""
    imports: dict[str, set[str]] = {folder: set() for folder in RUST_LAYERS}
    for path in CORE.rglob("*.rs"):
        parts = path.relative_to(CORE).parts
        if len(parts) == 1:
            continue
        supers = len(parts) - (1 if path.name == "mod.rs" else 0)
        imports[parts[0]] |= crate_modules(path.read_text(encoding="utf-8"), supers) & (set(RUST_LAYERS) - {parts[0]})
    return imports


def python_imports(path: Path, *, top_level_only: bool = False) -> list[tuple[int, str]]:
    """(line, absolute module name) of each import; relative ones are resolved inside `addon`."""
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    package = ["addon", *path.relative_to(ADDON).parent.parts]
    found = []
    for node in tree.body if top_level_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            stem = [*base, *([node.module] if node.module else [])]
            found += [(node.lineno, ".".join([*stem, alias.name])) for alias in node.names]
    return found


def test_the_rust_reader_sees_every_way_of_importing() -> None:
    text = (
        "use crate::{mesh::{A, B}, progress::P, linalg};\nlet x = crate::rig::Y;\nuse super::super::pbd; // crate::cage"
    )
    assert crate_modules(text, 2) == {"mesh", "progress", "linalg", "rig", "pbd"}
    assert crate_modules("use super::spectral::Z;", 1) == {"spectral"}


def test_rust_folders_are_known_layers() -> None:
    assert {path.name for path in CORE.iterdir() if path.is_dir()} <= set(RUST_LAYERS)


def test_rust_imports_nothing_from_a_higher_layer() -> None:
    upward = [
        f"{folder} imports {other}"
        for folder, others in rust_imports().items()
        for other in others
        if RUST_LAYERS[other] > RUST_LAYERS[folder]
    ]
    assert not upward


def test_rust_folders_import_in_no_circle() -> None:
    imports = rust_imports()
    while imports:
        free = [folder for folder, others in imports.items() if not others & set(imports)]
        assert free, f"a circle among {sorted(imports)}"
        for folder in free:
            del imports[folder]


def test_the_core_knows_neither_python_nor_numpy() -> None:
    manifest = (ROOT / "native" / "core" / "Cargo.toml").read_text(encoding="utf-8")
    assert not re.search(r"^(pyo3|numpy)\b", manifest, re.MULTILINE)
    for path in CORE.rglob("*.rs"):
        assert not re.search(r"\b(pyo3|numpy)::", without_comments(path.read_text(encoding="utf-8"))), relative(path)


def test_only_linalg_knows_faer() -> None:
    for path in CORE.rglob("*.rs"):
        if path.relative_to(CORE).parts[0] != "linalg":
            assert not re.search(r"\bfaer::", without_comments(path.read_text(encoding="utf-8"))), relative(path)


def test_addon_imports_nothing_at_its_top() -> None:
    tops = {name.split(".")[0] for _, name in python_imports(ADDON / "__init__.py", top_level_only=True)}
    assert tops <= {"__future__"}


@pytest.mark.parametrize("layer", ADDON_LAYERS)
def test_addon_imports_nothing_from_a_higher_layer(layer: str) -> None:
    for path in (ADDON / layer).rglob("*.py"):
        for line, name in python_imports(path):
            parts = name.split(".")
            where = f"{relative(path)}:{line} imports {name}"
            if layer == "core":
                assert parts[0] not in BLENDER_MODULES, where
            if parts[0] == "addon" and len(parts) > 1:
                assert ADDON_LAYERS.get(parts[1], 0) <= ADDON_LAYERS[layer], where


def test_operators_report_where_commands_hear_it() -> None:
    for path in (ADDON / "ui").rglob("*.py"):
        if path.name != "operator_base.py":
            assert "self.report(" not in path.read_text(encoding="utf-8"), f"{relative(path)}: use self.tell"


def test_the_bpy_free_half_can_be_imported_alone() -> None:
    modules = ["addon"]
    for path in shipped_files(".py"):
        if path.is_relative_to(ADDON / "core"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            modules.append(".".join(parts[:-1] if parts[-1] == "__init__" else parts))
    block = f"import sys; sys.modules.update(dict.fromkeys({sorted(BLENDER_MODULES)!r}))"
    code = f"{block}\nfor name in {modules!r}: __import__(name)"
    answer = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
