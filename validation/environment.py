"""Where the checks run: their own virtual environment (.venv at the project root), and Sunstone itself."""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
LLVM = Path("/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")


def enter():
    """Runs the calling script inside .venv, made as requirements.txt says, with LLVM in Mitsuba's reach if there is one."""
    venv = ROOT / ".venv"
    requirements = (HERE / "requirements.txt").read_text()
    stamp = venv / "requirements.installed"
    if not stamp.exists() or stamp.read_text() != requirements:
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
        pip = [venv / "bin/python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        subprocess.run([*pip, "-r", HERE / "requirements.txt"], check=True)
        stamp.write_text(requirements)
    if Path(sys.prefix).resolve() != venv.resolve():
        os.execv(venv / "bin/python", [str(venv / "bin/python"), *sys.argv])
    if LLVM.exists():
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(LLVM))


def sunstone():
    """Path of the program; built if there is none."""
    program = Path(os.environ.get("SUNSTONE", ROOT / "target/release/sunstone"))
    if not program.exists():
        subprocess.run(["cargo", "build", "--release", "--locked"], cwd=ROOT, check=True)
    return program
