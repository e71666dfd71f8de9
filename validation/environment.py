"""Environment of the validation scripts: their virtual environment (.venv at the project root) and the Sunstone program."""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent


def enter():
    """Re-run the calling script inside .venv, created from requirements.txt, with Mitsuba's path to LLVM set if LLVM is
    installed.
    """
    venv = ROOT / ".venv"
    requirements = (HERE / "requirements.txt").read_text()
    stamp = venv / "requirements.installed"
    if not stamp.exists() or stamp.read_text() != requirements:
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
        pip = [venv / "bin/python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        wanted = ["-r", HERE / "requirements.txt"]
        # uv needs 14 processor-seconds for these packages, pip 225. Where only pip is set up to reach an index, pip installs them.
        subprocess.run([*pip, next(line for line in requirements.splitlines() if line.startswith("uv=="))], check=True)
        uv = [venv / "bin/uv", "pip", "install", "--quiet", "--python", venv / "bin/python"]
        if subprocess.run([*uv, *wanted]).returncode != 0:
            subprocess.run([*pip, *wanted], check=True)
        stamp.write_text(requirements)
    if Path(sys.prefix).resolve() != venv.resolve():
        os.execv(venv / "bin/python", [str(venv / "bin/python"), *sys.argv])
    for llvm in Path("/usr/lib").glob("*/libLLVM.so.19.1"):
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(llvm))


def need_llvm(variant, otherwise):
    """Set a variant of Mitsuba that needs LLVM; exit if it does not start. `otherwise` describes the alternative."""
    import mitsuba as mi

    try:
        mi.set_variant(variant)
        started = float((mi.Float(1) + 1)[0]) == 2
    except Exception as error:
        print(error, file=sys.stderr)
        started = False
    if not started:
        print(f"Mitsuba's {variant} does not start because LLVM is missing: on Debian, apt-get install libllvm19; elsewhere, set "
              f"DRJIT_LIBLLVM_PATH to the library. {otherwise}", file=sys.stderr)
        sys.exit(3)


def in_memory():
    """Return a folder in memory for the files of timed commands, or None if the system has none.

    A disk that other processes use would stall the flushes of the files.
    """
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else None


def sunstone():
    """Return the path of the program; build it if it does not exist."""
    program = Path(os.environ.get("SUNSTONE", ROOT / "target/release/sunstone"))
    if not program.exists():
        subprocess.run(["cargo", "build", "--release", "--locked"], cwd=ROOT, check=True)
    return program


if __name__ == "__main__":
    enter()
