"""The zip's builder refuses what Blender's own validation lets through."""

from __future__ import annotations

import tomllib
import zipfile
from pathlib import Path

import build_zip
import project
import pytest
from build_zip import PackagingError, check_zip, platform_of, with_wheels
from checkout import ROOT

LINUX = "dermis_native-1.2.3-cp311-abi3-manylinux_2_28_x86_64.whl"
MACOS = "dermis_native-1.2.3-cp311-abi3-macosx_11_0_arm64.whl"
MANIFEST = """schema_version = "1.0.0"
id = "dermis"
version = "1.2.3"
type = "add-on"
tagline = "Skin"
license = ["SPDX:GPL-3.0-or-later"]
wheels = [
    "./wheels/stale.whl",
]

[permissions]
files = "Write caches"
"""


def write_zip(path: Path, *, manifest: str | None = None, **files: str) -> Path:
    content = {
        "blender_manifest.toml": with_wheels(MANIFEST, [LINUX]) if manifest is None else manifest,
        "__init__.py": "",
        "LICENSE": "GPL",
        f"wheels/{LINUX}": "",
        **files,
    }
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in content.items():
            archive.writestr(name, text)
    return path


@pytest.mark.parametrize(
    ("tag", "platform"),
    [
        ("manylinux_2_28_x86_64", "linux-x64"),
        ("manylinux_2_17_x86_64.manylinux2014_x86_64", "linux-x64"),
        ("linux_aarch64", "linux-arm64"),
        ("macosx_11_0_arm64", "macos-arm64"),
        ("win_amd64", "windows-x64"),
    ],
)
def test_platform_of_a_wheel(tag: str, platform: str) -> None:
    assert platform_of(f"dermis_native-1.2.3-cp311-abi3-{tag}.whl") == platform


@pytest.mark.parametrize(
    "name",
    [
        "dermis_native-1.2.3-cp311-cp311-manylinux_2_28_x86_64.whl",
        "dermis_native-1.2.3-cp311-abi3-musllinux_1_2_x86_64.whl",
        "dermis_native-1.2.3.tar.gz",
    ],
)
def test_a_wheel_that_blender_cannot_use_is_refused(name: str) -> None:
    with pytest.raises(PackagingError, match="dermis_native"):
        platform_of(name)


def test_wheels_replace_the_list_and_tables_stay_last() -> None:
    manifest = tomllib.loads(with_wheels(MANIFEST, [LINUX, MACOS]))
    assert manifest["wheels"] == [f"./wheels/{LINUX}", f"./wheels/{MACOS}"]
    assert manifest["platforms"] == ["linux-x64", "macos-arm64"]
    assert manifest["permissions"] == {"files": "Write caches"}


def test_a_good_zip_passes(tmp_path: Path) -> None:
    check_zip(write_zip(tmp_path / "good.zip"), "1.2.3")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"manifest": with_wheels(MANIFEST, [LINUX, MACOS])}, "arm64.whl is missing"),
        ({"manifest": MANIFEST.replace('    "./wheels/stale.whl",\n', "")}, "lists no wheel"),
        ({"manifest": with_wheels(MANIFEST, [LINUX]).replace("GPL-3.0-or-later", "MIT")}, "license"),
        ({"manifest": with_wheels(MANIFEST, [LINUX]).replace('"1.2.3"', '"1.2.4"')}, "version"),
        ({"manifest": with_wheels(MANIFEST, [LINUX]).replace("linux-x64", "windows-x64")}, "platforms"),
        ({"manifest": with_wheels(MANIFEST, [LINUX]).replace('"Skin"', '"Skin."')}, "full stop"),
        ({f"wheels/{MACOS}": ""}, "not listed"),
        ({"core/__pycache__/x.pyc": ""}, "does not belong"),
    ],
)
def test_a_bad_zip_is_refused(tmp_path: Path, change: dict[str, str], message: str) -> None:
    with pytest.raises(PackagingError, match=message):
        check_zip(write_zip(tmp_path / "bad.zip", **change), "1.2.3")


def test_a_source_that_does_not_compile_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SyntaxError):
        check_zip(write_zip(tmp_path / "bad.zip", **{"core/broken.py": "def ("}), "1.2.3")


def test_the_built_zip_passes() -> None:
    version = project.version()
    path = build_zip.DIST / f"dermis-{version}.zip"
    if not path.is_file():
        pytest.skip("dist/ has no zip; make zip builds it")
    check_zip(path, version)
    with zipfile.ZipFile(path) as archive:
        packed = {name for name in archive.namelist() if name.endswith(".py")}
    assert packed == {p.relative_to(ROOT / "addon").as_posix() for p in project.sources(ROOT / "addon", ".py")}
