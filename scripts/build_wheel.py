# SPDX-License-Identifier: MIT OR Apache-2.0
"""Build the wheel of the Rust core in release mode into `dist/` and install it into `.venv`."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from project import DIST, ROOT, VENV_PYTHON, fail, fingerprint, forget, is_done, mark_done, run, say, sources, version

STEP = "wheel"
BINDING = ROOT / "native" / "python"


def wheels() -> list[Path]:
    """The wheels in `dist/`."""
    return sorted(DIST.glob("dermis_native-*.whl"))


def main() -> None:
    rust = [ROOT / "Cargo.toml", ROOT / "Cargo.lock", *sources(ROOT / "native", ".rs", ".toml", ".pyi")]
    environment = (ROOT / ".setup" / "environment").read_text(encoding="utf-8")
    current = fingerprint([*rust, Path(__file__).resolve()], environment)
    if is_done(STEP, current) and len(wheels()) == 1:
        return
    forget(STEP)
    say("Building the Rust core and its Python module in release mode (the first time takes several minutes)")
    DIST.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=DIST) as folder:
        manifest = str(BINDING / "Cargo.toml")
        build = [str(VENV_PYTHON), "-m", "maturin", "build", "--release", "--locked", "--manifest-path", manifest]
        run([*build, "--interpreter", str(VENV_PYTHON), "--out", folder])
        built = list(Path(folder).glob(f"dermis_native-{version()}-*.whl"))
        if len(built) != 1:
            fail(f"maturin left {len(built)} wheels of version {version()} instead of one")
        for old in wheels():
            old.unlink()
        wheel = Path(shutil.move(str(built[0]), DIST / built[0].name))
    say(f"Installing {wheel.name} into .venv")
    pip = [str(VENV_PYTHON), "-m", "pip", "install", "--disable-pip-version-check"]
    run([*pip, "--no-deps", "--force-reinstall", str(wheel)])
    run([str(VENV_PYTHON), "-c", "import dermis_native; print('    dermis_native', dermis_native.__version__)"])
    mark_done(STEP, current)


if __name__ == "__main__":
    main()
