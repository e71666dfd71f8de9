"""The command `sunstone`, run on arrays: they go to it and come back as files of NumPy, with the very numbers of the command line."""

# pyright: basic
from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["CommandError", "find", "run", "run_on_arrays"]


class CommandError(ValueError):
    """The command refused, or there is none; the text is its own."""


def find() -> str:
    """The command: what the variable SUNSTONE names, or `sunstone` of this Python's own scripts, or of the PATH."""
    scripts = sysconfig.get_path("scripts")
    found = os.environ.get("SUNSTONE") or shutil.which("sunstone", path=scripts) or shutil.which("sunstone")
    if not found:
        raise CommandError("there is no command `sunstone`: put it into the PATH, or its place into the variable SUNSTONE")
    return found


def run(*words: object, command: str | None = None, tied: bool = False) -> str:
    """Run the command, and return what it prints.

    Parameters
    ----------
    words
        Its words.
    command
        The command, instead of that of `find`.
    tied
        Whether it dies with this process, where the system can see to that.

    Raises
    ------
    CommandError
        With what the command says, if it fails.
    """
    name = command or find()
    if shutil.which(name) is None:
        raise CommandError(f"there is no command `{name}`: install it, or say where it is")
    ties = shutil.which("setpriv") if tied else None
    tie = [ties, "--pdeathsig", "KILL"] if ties else []
    done = subprocess.run([*tie, name, *map(str, words)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise CommandError(done.stderr.strip() or f"{name} ended with code {done.returncode}")
    return done.stdout


def run_on_arrays(
    words: list[object],
    inputs: Mapping[str, npt.NDArray[Any]],
    outputs: Mapping[str, str],
    texts: Mapping[str, str] | None = None,
) -> dict[str, npt.NDArray[Any]]:
    """Run the command on arrays.

    Parameters
    ----------
    words
        The command's words; ``{NAME}`` stands for the file of the input or text of that name.
    inputs
        Arrays by name.
    outputs
        Options that take a file to write, and the file's extension: ``{"--output": "npy"}``.
    texts
        Contents of files of TOML by name.

    Returns
    -------
    dict
        Arrays by option; those of an ``npz`` by their own names.
    """
    with tempfile.TemporaryDirectory(prefix="pysunstone-") as folder:
        files = {}
        for name, values in inputs.items():
            files[name] = str(Path(folder, f"{name}.npy"))
            np.save(files[name], np.ascontiguousarray(values))
        for name, text in (texts or {}).items():
            files[name] = str(Path(folder, f"{name}.toml"))
            Path(files[name]).write_text(text)
        full = [str(word).format(**files) if str(word).startswith("{") else str(word) for word in words]
        for option, kind in outputs.items():
            full += [option, str(Path(folder, f"out{option}.{kind}"))]
        run(*full)
        found: dict[str, npt.NDArray[Any]] = {}
        for option, kind in outputs.items():
            loaded = np.load(Path(folder, f"out{option}.{kind}"))
            found.update(dict(loaded) if kind == "npz" else {option: loaded})
        return found
