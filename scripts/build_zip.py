# SPDX-License-Identifier: MIT OR Apache-2.0
"""Build the Blender extension `dist/dermis-VERSION.zip` from `addon/` and the wheels in `dist/`.

Blender's own command line packs and validates; it is lenient, so what it misses is checked here
before the zip takes the place of an older one.
"""

from __future__ import annotations

import re
import shutil
import tempfile
import tomllib
import zipfile
from pathlib import Path

from build_wheel import wheels
from project import DIST, ROOT, VENV, VENV_PYTHON, fail, fingerprint, forget, is_done, mark_done, run, say, sources
from project import version as project_version

STEP = "zip"
ADDON = ROOT / "addon"
MANIFEST = "blender_manifest.toml"
LICENCE = "SPDX:GPL-3.0-or-later"

# Blender's names of platforms, by the end of a wheel's platform tag.
PLATFORMS = {
    r"(many)?linux.*_x86_64": "linux-x64",
    r"(many)?linux.*_aarch64": "linux-arm64",
    r"macosx_.*_arm64": "macos-arm64",
    r"macosx_.*_x86_64": "macos-x64",
    r"win_amd64": "windows-x64",
    r"win_arm64": "windows-arm64",
}


class PackagingError(Exception):
    """The extension would not install or would not be accepted."""


def platform_of(wheel_name: str) -> str:
    """Blender's platform of a wheel that runs on every Python from 3.11 on."""
    parts = wheel_name.removesuffix(".whl").split("-")
    if len(parts) != 5 or not wheel_name.endswith(".whl"):
        raise PackagingError(f"{wheel_name} is not the name of a wheel")
    if parts[2:4] != ["cp311", "abi3"]:
        raise PackagingError(f"{wheel_name} is tagged {parts[2]}-{parts[3]}, not cp311-abi3")
    for pattern, platform in PLATFORMS.items():
        if re.fullmatch(pattern, parts[4].split(".")[0]):
            return platform
    raise PackagingError(f"{wheel_name} is for the platform {parts[4]}, which Blender does not know")


def with_wheels(manifest: str, wheel_names: list[str]) -> str:
    """The manifest's text with its lists of platforms and wheels filled in."""
    kept = re.sub(r"^(wheels|platforms)\s*=\s*\[[^\]]*\][^\n]*\n", "", manifest, flags=re.MULTILINE)
    table = re.search(r"^\[", kept, re.MULTILINE)
    place = table.start() if table else len(kept)
    platforms = ", ".join(f'"{platform_of(name)}"' for name in wheel_names)
    paths = "".join(f'    "./wheels/{name}",\n' for name in wheel_names)
    lists = f"platforms = [{platforms}]\nwheels = [\n{paths}]\n\n"
    return kept[:place] + ("" if kept[:place].endswith("\n") else "\n") + lists + kept[place:]


def check_zip(path: Path, version: str) -> None:
    """Raise PackagingError for what Blender's validation lets through."""
    with zipfile.ZipFile(path) as archive:
        damaged = archive.testzip()
        if damaged is not None:
            raise PackagingError(f"{damaged} is damaged")
        names = set(archive.namelist())
        if MANIFEST not in names:
            raise PackagingError(f"no {MANIFEST} at the top of the zip")
        manifest = tomllib.loads(archive.read(MANIFEST).decode())
        for name in names:
            if name.endswith(".py"):
                compile(archive.read(name), name, "exec")
    expected = {"id": "dermis", "version": version, "type": "add-on", "license": [LICENCE]}
    for key, value in expected.items():
        if manifest.get(key) != value:
            raise PackagingError(f"the manifest's {key} is {manifest.get(key)!r}, not {value!r}")
    for text in [manifest["tagline"], *manifest.get("permissions", {}).values()]:
        if len(text) > 64 or text.endswith("."):
            raise PackagingError(f"longer than 64 characters or with a full stop at the end: {text!r}")
    for required in ("__init__.py", "LICENSE"):
        if required not in names:
            raise PackagingError(f"no {required} in the zip")
    listed = [wheel.removeprefix("./") for wheel in manifest.get("wheels", [])]
    if not listed:
        raise PackagingError("the manifest lists no wheel")
    packed = {name for name in names if name.endswith(".whl")}
    for wheel in sorted(packed.symmetric_difference(listed)):
        raise PackagingError(f"{wheel} is {'not listed in the manifest' if wheel in packed else 'missing'}")
    platforms = [platform_of(Path(wheel).name) for wheel in listed]
    if sorted(set(platforms)) != sorted(platforms) or sorted(manifest.get("platforms", [])) != sorted(platforms):
        raise PackagingError(f"platforms {manifest.get('platforms')} do not match the wheels ({', '.join(platforms)})")
    for wheel in listed:
        if Path(wheel).name.split("-")[:2] != ["dermis_native", version]:
            raise PackagingError(f"{wheel} is not dermis_native {version}")
    for name in sorted(names):
        if "__pycache__" in name or name.endswith((".pyc", ".blend1")):
            raise PackagingError(f"{name} does not belong into the zip")


def blender_extension_tool() -> Path:
    """Blender's command line for extensions, which needs no Blender to run."""
    found = sorted(VENV.glob("lib/python*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if not found:
        fail("the bpy package in .venv has no blender_ext.py")
    return found[-1]


def pack(target: Path, wheel_paths: list[Path]) -> None:
    """Stage the add-on with some wheels, pack it into `target`, and let Blender validate it."""
    tool = [str(VENV_PYTHON), str(blender_extension_tool())]
    with tempfile.TemporaryDirectory(dir=DIST) as folder:
        stage = Path(folder) / "dermis"
        shutil.copytree(ADDON, stage, ignore=shutil.ignore_patterns("__pycache__", "*.pyc", ".*", "wheels"))
        (stage / "wheels").mkdir()
        for wheel in wheel_paths:
            shutil.copy2(wheel, stage / "wheels")
        manifest = stage / MANIFEST
        names = [wheel.name for wheel in wheel_paths]
        manifest.write_text(with_wheels(manifest.read_text(encoding="utf-8"), names), encoding="utf-8")
        run([*tool, "build", "--source-dir", str(stage), "--output-filepath", str(target)])
        run([*tool, "validate", str(target)])


def build(target: Path, version: str, wheel_paths: list[Path]) -> None:
    """Pack and check, and only then replace `target`."""
    with tempfile.TemporaryDirectory(dir=DIST) as folder:
        packed = Path(folder) / target.name
        pack(packed, wheel_paths)
        check_zip(packed, version)
        for old in DIST.glob("dermis-*.zip"):
            old.unlink()
        packed.replace(target)


def main() -> None:
    version = project_version()
    wheel_paths = wheels()
    if not wheel_paths:
        fail("dist/ has no wheel; run: make wheel")
    target = DIST / f"dermis-{version}.zip"
    files = [*sources(ADDON), *wheel_paths, Path(__file__).resolve()]
    current = fingerprint(files, version)
    if is_done(STEP, current) and target.is_file():
        return
    forget(STEP)
    say(f"Building the Blender extension dist/{target.name}")
    try:
        build(target, version, wheel_paths)
    except (PackagingError, SyntaxError) as error:
        fail(f"{target.name}: {error}")
    mark_done(STEP, current)


if __name__ == "__main__":
    main()
