# SPDX-License-Identifier: MIT OR Apache-2.0
"""Install, use, upgrade, disable and remove the built zip in each Blender that it is for; prints a table.

Each Blender is the `bpy` package in an environment of its own under `.matrix/`. A Blender whose Python is not
on this machine is left out, with a line that says so.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from build_wheel import wheels
from build_zip import with_wheels
from project import DIST, ROOT, fail, run, say, version

MATRIX = ROOT / ".matrix"
CYCLE = ROOT / "blender_tests" / "install_cycle.py"
# The Blenders and their Pythons. numpy as Blender itself ships it with that release.
BLENDERS = {
    "4.2.23": ("3.11", "numpy==1.26.4"),
    "4.5.15": ("3.11", "numpy==1.26.4"),
    "5.0.1": ("3.11", "numpy==1.26.4"),
    "5.2.3": ("3.13", "numpy==2.4.6"),
}
STAGES = ("first", "upgrade", "use", "remove", "foreign")
STAGE_SECONDS = 300  # a stage that runs longer hangs
OLD = "0.0.1"


def python_of(release: str) -> str | None:
    """A Python of this release that starts."""
    found = shutil.which(f"python{release}")
    if found is None:
        return None
    return found if subprocess.run([found, "--version"], capture_output=True).returncode == 0 else None


def environment(blender: str) -> Path | None:
    """The Python of an environment with this Blender; None where the machine has no Python for it."""
    release, numpy = BLENDERS[blender]
    folder = MATRIX / blender
    python = folder / "bin" / "python"
    done = folder / "complete"
    if done.exists():
        return python
    base = python_of(release)
    if base is None:
        return None
    say(f"Making an environment with Blender {blender}")
    run([base, "-m", "venv", "--clear", str(folder)])
    run([str(python), "-m", "pip", "install", "--disable-pip-version-check", "--quiet", f"bpy=={blender}", numpy])
    done.touch()
    return python


def tag() -> str:
    """Python and platform tags of the wheel that was built here."""
    return wheels()[0].stem.split("-", 2)[2]


def write_zip(target: Path, number: str, wheel_tag: str) -> None:
    """A small extension of the same name with a native module in Python that knows its version and nothing else."""
    wheel = f"dermis_native-{number}-{wheel_tag}.whl"
    info = f"dermis_native-{number}.dist-info"
    with zipfile.ZipFile(target.with_suffix(".whl"), "w") as archive:
        archive.writestr("dermis_native.py", f'__version__ = "{number}"\n')
        archive.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: dermis-native\nVersion: {number}\n")
        archive.writestr(
            f"{info}/WHEEL", f"Wheel-Version: 1.0\nGenerator: x\nRoot-Is-Purelib: false\nTag: {wheel_tag}\n"
        )
        archive.writestr(f"{info}/RECORD", "dermis_native.py,,\n")
    manifest = (ROOT / "addon" / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = with_wheels(manifest.replace(f'version = "{version()}"', f'version = "{number}"'), [wheel])
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("blender_manifest.toml", manifest)
        archive.writestr(
            "__init__.py", "import dermis_native\n\n\ndef register():\n    pass\n\n\ndef unregister():\n    pass\n"
        )
        archive.write(target.with_suffix(".whl"), f"wheels/{wheel}")
    target.with_suffix(".whl").unlink()


def ended_well(python: Path, stage: str, profile: Path, path: Path) -> bool:
    """Run one stage and show what it says when it fails."""
    command = [str(python), str(CYCLE), stage, str(path)]
    own = {**os.environ, "DERMIS_PROFILE": str(profile)}
    try:
        answer = subprocess.run(
            command, env=own, capture_output=True, text=True, errors="replace", timeout=STAGE_SECONDS
        )
    except subprocess.TimeoutExpired:
        print(f"    {stage}: no end after {STAGE_SECONDS} s", flush=True)
        return False
    good = answer.returncode == 0 and answer.stdout.rstrip().endswith(f"{stage} ok")
    if not good:
        print(answer.stdout + answer.stderr, flush=True)
    return good


def cycle(python: Path, built: Path) -> dict[str, bool]:
    """All stages in one new profile; what follows a failure is not tried."""
    results = {}
    with tempfile.TemporaryDirectory(prefix="dermis-install-") as scratch:
        profile, old, foreign = Path(scratch) / "profile", Path(scratch) / "old.zip", Path(scratch) / "foreign.zip"
        profile.mkdir()
        write_zip(old, OLD, tag())
        elsewhere = "win_amd64" if platform.system() == "Linux" else "manylinux_2_28_x86_64"
        write_zip(foreign, version(), f"cp311-abi3-{elsewhere}")
        for stage in STAGES:
            path = {"first": old, "foreign": foreign}.get(stage, built)
            results[stage] = ended_well(python, stage, profile, path)
            if not results[stage]:
                break
    return results


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blenders", nargs="*", help=f"of {', '.join(BLENDERS)}; all when none is named")
    chosen = parser.parse_args().blenders or list(BLENDERS)
    unknown = [name for name in chosen if name not in BLENDERS]
    if unknown:
        fail(f"unknown Blender {', '.join(unknown)}; known are {', '.join(BLENDERS)}")
    built = DIST / f"dermis-{version()}.zip"
    if not built.is_file():
        fail("dist/ has no zip; run: make zip")
    table, failed = [], False
    for blender in chosen:
        python = environment(blender)
        if python is None:
            table.append(f"{blender:<8} {BLENDERS[blender][0]:<7} left out: no python{BLENDERS[blender][0]} here")
            continue
        say(f"Blender {blender}")
        results = cycle(python, built)
        failed = failed or not all(results.values())
        cells = ["-" if stage not in results else "ok" if results[stage] else "FAILED" for stage in STAGES]
        table.append(f"{blender:<8} {BLENDERS[blender][0]:<7} " + " ".join(f"{cell:<8}" for cell in cells).rstrip())
    print(f"\n{'Blender':<8} {'Python':<7} " + " ".join(f"{stage:<8}" for stage in STAGES).rstrip())
    print("\n".join(table), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
