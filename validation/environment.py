"""Where the checks run: their own virtual environment (.venv at the project root), and Sunstone itself."""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent


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
    for llvm in Path("/usr/lib").glob("*/libLLVM.so.19.1"):
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(llvm))


def need_llvm(variant, otherwise):
    """Sets a variant of Mitsuba that needs LLVM; ends the script if it does not start. `otherwise`: what to do without."""
    import mitsuba as mi

    try:
        mi.set_variant(variant)
        started = float((mi.Float(1) + 1)[0]) == 2
    except Exception as error:
        print(error, file=sys.stderr)
        started = False
    if not started:
        print(f"Mitsuba's {variant} does not start, for want of LLVM: on Debian, apt-get install libllvm19; elsewhere, name the "
              f"library in DRJIT_LIBLLVM_PATH. {otherwise}", file=sys.stderr)
        sys.exit(3)


def in_memory():
    """Where files of commands lie that are timed whole: in memory, since a disk that others use stalls their flushes; None where the
    system has no such place."""
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else None


def sunstone():
    """Path of the program; built if there is none."""
    program = Path(os.environ.get("SUNSTONE", ROOT / "target/release/sunstone"))
    if not program.exists():
        subprocess.run(["cargo", "build", "--release", "--locked"], cwd=ROOT, check=True)
    return program
