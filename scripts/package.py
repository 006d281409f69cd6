# SPDX-License-Identifier: MIT OR Apache-2.0
"""Build the extension for every platform into `dist/package/`: a zip for each and one for all.

All wheels are linked on this machine. zig is the linker, so no other system's compiler is needed; Rust's
standard libraries for the other systems come from rustup.
"""

from __future__ import annotations

import argparse
import os
import shutil
import struct
import subprocess
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from build_wheel import BINDING
from build_zip import PackagingError, check_zip, pack, platform_of
from project import DIST, ROOT, VENV, VENV_PYTHON, fail, run, say, version

PACKAGES = DIST / "package"
REQUIREMENTS = ROOT / "requirements-package.txt"


@dataclass(frozen=True)
class Platform:
    """One of Blender's platforms: Rust's name of it, and how its libraries begin (`head` at byte `place`)."""

    target: str
    place: int
    head: bytes
    options: tuple[str, ...] = ()


MANYLINUX = ("--compatibility", "manylinux_2_28")  # glibc of the oldest Linux that Blender 4.2 runs on
PLATFORMS = {
    # ELF: the machine is at byte 18; PE: after its signature; Mach-O of 64 bits: after its magic number.
    "linux-x64": Platform("x86_64-unknown-linux-gnu", 18, struct.pack("<H", 0x3E), MANYLINUX),
    "linux-arm64": Platform("aarch64-unknown-linux-gnu", 18, struct.pack("<H", 0xB7), MANYLINUX),
    "windows-x64": Platform("x86_64-pc-windows-gnu", -1, b"PE\0\0" + struct.pack("<H", 0x8664)),
    "macos-arm64": Platform("aarch64-apple-darwin", 0, struct.pack("<II", 0xFEEDFACF, 0x0100000C)),
}


def check_library(wheel: Path, platform: str) -> None:
    """Raise PackagingError when a wheel holds anything but one library for its platform."""
    if platform_of(wheel.name) != platform:
        raise PackagingError(f"{wheel.name} is for {platform_of(wheel.name)}, not for {platform}")
    with zipfile.ZipFile(wheel) as archive:
        libraries = [name for name in archive.namelist() if name.endswith((".so", ".pyd", ".dylib", ".dll"))]
        if len(libraries) != 1:
            raise PackagingError(f"{wheel.name} has {len(libraries)} libraries instead of one: {', '.join(libraries)}")
        content = archive.read(libraries[0])
    wanted = PLATFORMS[platform]
    place = struct.unpack_from("<I", content, 0x3C)[0] if wanted.place < 0 and len(content) > 0x40 else wanted.place
    if not content.startswith(wanted.head, max(place, 0)):
        raise PackagingError(f"{libraries[0]} in {wheel.name} is not a library for {platform}")


def add_targets(platforms: list[str]) -> None:
    """Fetch the standard libraries that are missing."""
    answer = subprocess.run(["rustc", "--print", "sysroot"], cwd=ROOT, capture_output=True, text=True)
    libraries = Path(answer.stdout.strip()) / "lib" / "rustlib"
    missing = [PLATFORMS[name].target for name in platforms if not (libraries / PLATFORMS[name].target).is_dir()]
    if not missing:
        return
    if shutil.which("rustup") is None:
        fail(f"Rust's standard library for {', '.join(missing)} is missing, and there is no rustup to fetch it")
    say(f"Fetching Rust's standard library for {', '.join(missing)}")
    run(["rustup", "target", "add", *missing])


def build_wheel(platform: str, folder: Path) -> Path:
    """The wheel for a platform, in `folder`."""
    say(f"Building the wheel for {platform}")
    wanted = PLATFORMS[platform]
    build = [str(VENV_PYTHON), "-m", "maturin", "build", "--release", "--locked", "--zig"]
    build += ["--manifest-path", str(BINDING / "Cargo.toml"), "--target", wanted.target, "--out", str(folder)]
    # maturin asks the first Python on the path for zig.
    run([*build, *wanted.options], {"PATH": os.pathsep.join([str(VENV / "bin"), os.environ.get("PATH", os.defpath)])})
    built = [path for path in folder.glob(f"dermis_native-{version()}-*.whl") if platform_of(path.name) == platform]
    if len(built) != 1:
        fail(f"maturin left {len(built)} wheels for {platform} instead of one")
    return built[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("platforms", nargs="*", help=f"of {', '.join(PLATFORMS)}; all when none is named")
    chosen = list(dict.fromkeys(parser.parse_args().platforms)) or list(PLATFORMS)
    unknown = [name for name in chosen if name not in PLATFORMS]
    if unknown:
        fail(f"unknown platform {', '.join(unknown)}; known are {', '.join(PLATFORMS)}")
    add_targets(chosen)
    pip = [str(VENV_PYTHON), "-m", "pip", "install", "--disable-pip-version-check", "--quiet"]
    run([*pip, "--requirement", str(REQUIREMENTS)])
    PACKAGES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=DIST) as scratch:
        wheels = {name: build_wheel(name, Path(scratch)) for name in chosen}
        groups = {name: [wheel] for name, wheel in wheels.items()}
        if len(chosen) > 1:
            groups["all"] = list(wheels.values())
        made = []
        try:
            for name, wheel in wheels.items():
                check_library(wheel, name)
            for name, group in groups.items():
                target = Path(scratch) / f"dermis-{version()}-{name}.zip"
                pack(target, group)
                check_zip(target, version())
                made.append(target)
        except (PackagingError, SyntaxError) as error:
            fail(str(error))
        # All or none: zips of two builds never stand side by side.
        for old in PACKAGES.glob("dermis-*.zip"):
            old.unlink()
        for target in made:
            placed = target.replace(PACKAGES / target.name)
            say(f"dist/package/{placed.name}: {placed.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
