# SPDX-License-Identifier: MIT OR Apache-2.0
"""A user's session in a real Blender with a window on a virtual screen; pictures of it go to `dist/window/`.

`--blender PROGRAM` takes a Blender of this machine, with Xvfb, xdotool and ImageMagick installed. Without it, and as
root on a machine with debootstrap, a folder `.window/` gets a Debian 13 with its Blender 4.3 (2 GB, some minutes).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from project import DIST, ROOT, fail, run, say, version

SYSTEM = ROOT / ".window"
PICTURES = DIST / "window"
DOCS = ROOT / "docs" / "images"
SESSION = ROOT / "blender_tests" / "window_session.py"
COMPARE = ROOT / "blender_tests" / "window_compare.py"
DEMO = ROOT / "demo" / "demo.blend"
GRAPHICS = ("libgl1-mesa-dri", "libegl1", "libegl-mesa0")
MODULES = ("python3-numpy", "python3-requests", "python3-zstandard")
PACKAGES = ("blender", "xvfb", "xdotool", "imagemagick", *GRAPHICS, *MODULES)
DEBIAN = ("trixie", "http://deb.debian.org/debian")
SESSION_SECONDS = 900  # a session that runs longer hangs
SCREEN = (1400, 1500)


@dataclass(frozen=True)
class Place:
    """Where the session runs: what goes before a command, its folder as this program and as Blender see it."""

    prefix: tuple[str, ...]
    blender: str
    folder: Path
    inside: Path


def system_folder() -> Path:
    """A Debian with a Blender, made once."""
    done = SYSTEM / "complete"
    if done.exists():
        return SYSTEM
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        fail(
            "there is no Blender with a window to be tried: name one with\n"
            "    make window-test BLENDER=/path/to/blender\n"
            "or run as root after: apt-get install debootstrap"
        )
    say("Setting up a Debian with a Blender in .window/ (some minutes)")
    SYSTEM.mkdir(exist_ok=True)
    if not (SYSTEM / "etc" / "debian_version").exists():
        run(["debootstrap", "--variant=minbase", DEBIAN[0], str(SYSTEM), DEBIAN[1]])
    install = ["apt-get", "install", "--yes", "--no-install-recommends", *PACKAGES]
    run(["chroot", str(SYSTEM), "apt-get", "update"], {"DEBIAN_FRONTEND": "noninteractive"})
    run(["chroot", str(SYSTEM), *install], {"DEBIAN_FRONTEND": "noninteractive"})
    done.touch()
    return SYSTEM


def place(blender: str | None, scratch: Path) -> Place:
    """The Blender that was asked for, or the one of `.window/`."""
    if blender is not None:
        missing = [name for name in (blender, "Xvfb", "xdotool", "import") if shutil.which(name) is None]
        if missing:
            fail(f"not found: {', '.join(missing)}")
        return Place((), blender, scratch, scratch)
    folder = system_folder() / "tmp" / scratch.name
    folder.mkdir()
    return Place(("chroot", str(SYSTEM)), "blender", folder, Path("/", "tmp", scratch.name))


def session(where: Place, zip_path: Path) -> list[dict[str, str | bool]]:
    """Install the zip by Blender's command line, run the session on a virtual screen, and give its result."""
    profile = where.inside / "profile"
    (where.folder / "profile").mkdir()
    for path in (zip_path, DEMO, SESSION, COMPARE):
        shutil.copy2(path, where.folder)
    told: list[dict[str, str | bool]] = []
    screen = f":{90 + os.getpid() % 900}"
    own = {
        **os.environ,
        "BLENDER_USER_RESOURCES": str(profile),
        "HOME": str(where.inside),
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "DISPLAY": screen,
    }

    def command(*words: str) -> list[str]:
        return [*where.prefix, *words]

    width, height = SCREEN
    with (where.folder / "log.txt").open("w") as log:
        server = subprocess.Popen(
            command("Xvfb", screen, "-screen", "0", f"{width}x{height}x24"), env=own, stdout=log, stderr=log
        )
        try:
            time.sleep(2)
            say("Installing the zip with blender --command extension")
            zip_inside = str(where.inside / zip_path.name)
            install = command(
                where.blender, "--command", "extension", "install-file", "-r", "user_default", "-e", zip_inside
            )
            subprocess.run(install, env=own, stdout=log, stderr=log, timeout=SESSION_SECONDS, check=True)
            say("A session in the window")
            start = command(
                where.blender, "--gpu-backend", "opengl", "--window-geometry", "0", "0", str(width), str(height)
            )
            start += ["--python", str(where.inside / SESSION.name), "--", str(where.inside)]
            subprocess.run(start, env=own, stdout=log, stderr=log, timeout=SESSION_SECONDS, check=True)
            say("The same without a window")

            def without_window(*words: str) -> int:
                background = command(where.blender, *words)
                return subprocess.run(background, env=own, stdout=log, stderr=log, timeout=SESSION_SECONDS).returncode

            told = commands(where, without_window)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            print((where.folder / "log.txt").read_text(errors="replace")[-3000:], flush=True)
            print(error, flush=True)
        finally:
            server.terminate()
            server.wait()
    result = where.folder / "result.json"
    if not result.is_file():
        return [{"step": "the session came to its end", "ok": False, "text": "it left no result"}]
    return [*json.loads(result.read_text(encoding="utf-8")), *told]


def commands(where: Place, blender: Callable[..., int]) -> list[dict[str, str | bool]]:
    """What `blender --command dermis` does with the session's files; `blender` gives an exit code."""
    source, target = json.loads((where.folder / "names.json").read_text(encoding="utf-8"))
    bare, button, written, skinned, baked = (
        str(where.inside / f"{name}.blend") for name in ("bare", "button", "command", "skinned", "baked")
    )
    retarget = ("retarget", "--file", bare, "--output", written, "--source", source, "--targets", target)
    skin = ("skin", "--file", written, "--output", skinned, "--objects", target)
    bake = ("bake", "--file", skinned, "--output", baked, "--objects", target, "--directory", "//caches")
    compare = ("--background", "--factory-startup", "--python-exit-code", "1", "--python")
    steps = {
        "blender --command dermis retarget": blender("--command", "dermis", *retarget) == 0,
        "its weights are the button's": blender(
            *compare, str(where.inside / COMPARE.name), "--", target, button, written
        )
        == 0,
        "blender --command dermis skin": blender("--command", "dermis", *skin) == 0,
        "blender --command dermis bake": blender("--command", "dermis", *bake) == 0
        and len(list((where.folder / "caches").glob("*.pc2"))) == 1,
        "a wrong option is exit code 2": blender("--command", "dermis", *retarget, "--max-influence", "4") == 2,
    }
    return [{"step": step, "ok": good, "text": ""} for step, good in steps.items()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blender", help="a Blender of this machine instead of the one in .window/")
    parser.add_argument("--docs", action="store_true", help="renew those pictures that docs/images has")
    arguments = parser.parse_args()
    zip_path = DIST / f"dermis-{version()}.zip"
    if not zip_path.is_file() or not DEMO.is_file():
        fail("the zip and demo/demo.blend are needed; run: make window-test")
    with tempfile.TemporaryDirectory(prefix="dermis-window-") as scratch:
        where = place(arguments.blender or None, Path(scratch))
        try:
            steps = session(where, zip_path)
            PICTURES.mkdir(parents=True, exist_ok=True)
            for path in sorted(where.folder.glob("*.png")):
                shutil.copy2(path, PICTURES)
        finally:
            if where.folder != Path(scratch):
                shutil.rmtree(where.folder)
    if arguments.docs:
        for path in sorted(DOCS.glob("window_*.png")):
            with Image.open(PICTURES / path.name.removeprefix("window_")) as image:
                small = image.convert("P", palette=Image.Palette.ADAPTIVE, colors=256)
            small.save(path, optimize=True)
    print()
    for each in steps:
        print(f"{'ok    ' if each['ok'] else 'FAILED'}  {each['step']}" + (f": {each['text']}" if each["text"] else ""))
    say("Pictures: dist/window/")
    return 0 if all(each["ok"] for each in steps) else 1


if __name__ == "__main__":
    sys.exit(main())
