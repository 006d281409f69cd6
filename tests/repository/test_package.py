"""Zips for other systems hold libraries for those systems; the zips that the install test makes are what it needs."""

from __future__ import annotations

import struct
import tomllib
import zipfile
from pathlib import Path

import build_zip
import install_matrix
import package
import pytest
from build_zip import PackagingError
from package import check_library

TAGS = {
    "linux-x64": "manylinux_2_28_x86_64",
    "linux-arm64": "manylinux_2_28_aarch64",
    "windows-x64": "win_amd64",
    "macos-arm64": "macosx_11_0_arm64",
}


def head(platform: str) -> bytes:
    """The first bytes of a library, as the formats' descriptions give them."""
    return {
        "linux-x64": b"\x7fELF\x02\x01\x01" + bytes(9) + b"\x03\x00\x3e\x00",
        "linux-arm64": b"\x7fELF\x02\x01\x01" + bytes(9) + b"\x03\x00\xb7\x00",
        "windows-x64": b"MZ" + bytes(58) + struct.pack("<I", 0x80) + bytes(64) + b"PE\0\0\x64\x86" + bytes(18),
        "macos-arm64": bytes.fromhex("cffaedfe0c00000100000000") + bytes(20),
    }[platform]


def write_wheel(folder: Path, platform: str, **libraries: bytes) -> Path:
    path = folder / f"dermis_native-1.2.3-cp311-abi3-{TAGS[platform]}.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in libraries.items():
            archive.writestr(f"dermis_native/{name.replace('_', '.')}", content)
    return path


def test_every_platform_is_one_of_blenders() -> None:
    assert set(package.PLATFORMS) == set(TAGS)
    assert set(package.PLATFORMS) <= set(build_zip.PLATFORMS.values())


@pytest.mark.parametrize("platform", TAGS)
def test_a_library_is_for_one_platform_alone(tmp_path: Path, platform: str) -> None:
    for other in TAGS:
        wheel = write_wheel(tmp_path, platform, dermis_so=head(other))
        if other == platform:
            check_library(wheel, platform)
        else:
            with pytest.raises(PackagingError, match=f"is not a library for {platform}"):
                check_library(wheel, platform)


def test_a_wheel_without_its_library_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"MZ", head("windows-x64")[:100]):
        with pytest.raises(PackagingError, match="is not a library"):
            check_library(write_wheel(tmp_path, "windows-x64", dermis_pyd=content), "windows-x64")
    with pytest.raises(PackagingError, match="0 libraries"):
        check_library(write_wheel(tmp_path, "linux-x64"), "linux-x64")
    both = {"a_so": head("linux-x64"), "b_so": head("linux-x64")}
    with pytest.raises(PackagingError, match="2 libraries"):
        check_library(write_wheel(tmp_path, "linux-x64", **both), "linux-x64")
    with pytest.raises(PackagingError, match="is for linux-x64, not for linux-arm64"):
        check_library(write_wheel(tmp_path, "linux-x64", a_so=head("linux-x64")), "linux-arm64")


def test_the_older_version_of_the_install_test(tmp_path: Path) -> None:
    target = tmp_path / "old.zip"
    install_matrix.write_zip(target, install_matrix.OLD, "cp311-abi3-manylinux_2_28_x86_64")
    assert [path.name for path in tmp_path.iterdir()] == ["old.zip"]
    with zipfile.ZipFile(target) as archive:
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        assert manifest["version"] == install_matrix.OLD
        assert manifest["id"] == "dermis"
        assert [f"./{name}" for name in archive.namelist() if name.endswith(".whl")] == manifest["wheels"]
