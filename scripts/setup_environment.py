# SPDX-License-Identifier: MIT OR Apache-2.0
"""Make `.venv` with pinned packages, and see that the machine has what they need.

Run by the Python that the environment is made from. As root on a machine with apt, missing system
packages are installed; otherwise the exact command is printed and nothing is changed.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys

from project import ROOT, VENV, VENV_PYTHON, fail, fingerprint, forget, is_done, mark_done, run, say

STEP = "environment"
REQUIREMENTS = ROOT / "requirements.txt"
DATA_REQUIREMENTS = ROOT / "requirements-data.txt"
PYTHONS = {(3, 11): "bpy 4.5 LTS", (3, 13): "bpy 5.2 LTS"}

# What Blender as a Python module links to and a bare Debian or Ubuntu lacks.
SHARED_LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libxkbcommon.so.0": "libxkbcommon0",
}


def check_python() -> None:
    """Blender as a Python module exists for two Pythons only."""
    if sys.version_info[:2] in PYTHONS:
        return
    known = " or ".join(f"Python {major}.{minor} ({bpy})" for (major, minor), bpy in PYTHONS.items())
    fail(
        f"this is Python {sys.version_info[0]}.{sys.version_info[1]}, but Blender as a Python module needs {known}.\n"
        "Install one of them, for example on Debian 12:\n"
        "    apt-get install python3.11 python3.11-venv\n"
        "on Debian 13:\n"
        "    apt-get install python3.13 python3.13-venv\n"
        "or anywhere with uv: uv python install 3.11. If make does not find it by itself, name it:\n"
        "    make PYTHON=/path/to/python3.11 demo"
    )


def check_rust() -> None:
    """The compiler must be there and new enough; it is never installed by us."""
    found = re.search(r'^rust-version\s*=\s*"([\d.]+)"', (ROOT / "Cargo.toml").read_text(encoding="utf-8"), re.M)
    needed = found.group(1) if found else "1.89"
    advice = f"install Rust {needed} or newer, for example with rustup (https://rustup.rs)"
    if shutil.which("cargo") is None or shutil.which("rustc") is None:
        fail(f"cargo is not on the PATH: {advice}")
    answer = subprocess.run(["rustc", "--version"], cwd=ROOT, capture_output=True, text=True)
    version = re.match(r"rustc (\d+)\.(\d+)", answer.stdout)
    if version is None:
        fail(f"rustc --version failed: {answer.stderr.strip()}")
    if tuple(map(int, version.groups())) < tuple(map(int, needed.split(".")[:2])):
        fail(f"this is rustc {version.group(1)}.{version.group(2)}: {advice}")


def missing_system_packages() -> list[str]:
    """Debian packages that the next steps need and that are not there."""
    missing = []
    if shutil.which("cc") is None:
        missing.append("build-essential")
    if importlib.util.find_spec("ensurepip") is None or importlib.util.find_spec("venv") is None:
        missing.append(f"python{sys.version_info[0]}.{sys.version_info[1]}-venv")
    for library, package in SHARED_LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            missing.append(package)
    return missing


def install_system_packages(packages: list[str]) -> None:
    """Install with apt as root; otherwise say how and stop."""
    install = ["apt-get", "install", "--yes", "--no-install-recommends", *packages]
    if shutil.which("apt-get") is None:
        fail(f"system packages are missing; their names on Debian: {' '.join(packages)}")
    if os.geteuid() != 0:
        fail(
            "system packages are missing; install them, then run make again:\n"
            f"    sudo apt-get update && sudo {shlex.join(install)}"
        )
    say(f"Installing system packages: {' '.join(packages)}")
    quiet = {"DEBIAN_FRONTEND": "noninteractive"}
    run(["apt-get", "update"], quiet)
    run(install, quiet)


def venv_works() -> bool:
    """True when `.venv` has pip and the Python that runs this script."""
    if not VENV_PYTHON.exists():
        return False
    probe = "import pip, sys; print(*sys.version_info[:3])"
    answer = subprocess.run([str(VENV_PYTHON), "-c", probe], capture_output=True, text=True)
    return answer.returncode == 0 and answer.stdout.split() == [str(part) for part in sys.version_info[:3]]


def check_bpy() -> None:
    """Name every shared library that Blender's module still lacks, then import it once."""
    pattern = "lib/python*/site-packages/bpy/__init__*.so"
    for module in VENV.glob(pattern):
        answer = subprocess.run(["ldd", str(module)], capture_output=True, text=True)
        absent = sorted({line.split()[0] for line in answer.stdout.splitlines() if "not found" in line})
        if absent:
            fail(f"Blender's module lacks shared libraries: {', '.join(absent)}; install the packages that have them")
    leave = "import os, bpy; print('    Blender', bpy.app.version_string, flush=True); os._exit(0)"
    run([str(VENV_PYTHON), "-c", leave])


def main() -> None:
    check_python()
    check_rust()
    current = fingerprint([REQUIREMENTS, DATA_REQUIREMENTS, ROOT / "scripts" / "setup_environment.py"], sys.version)
    packages = missing_system_packages()
    if packages:
        install_system_packages(packages)
    if is_done(STEP, current) and VENV_PYTHON.exists():
        return
    forget(STEP)
    if not venv_works():
        say(f"Creating .venv with Python {sys.version.split()[0]}")
        run([sys.executable, "-m", "venv", "--clear", str(VENV)])
    say("Installing pinned packages into .venv (Blender is the large one: 350 MB)")
    pip = [str(VENV_PYTHON), "-m", "pip", "install", "--disable-pip-version-check"]
    run([*pip, "--requirement", str(REQUIREMENTS)])
    run([*pip, "--no-deps", "--requirement", str(DATA_REQUIREMENTS)])
    check_bpy()
    mark_done(STEP, current)


if __name__ == "__main__":
    main()
