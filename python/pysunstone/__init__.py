"""Polarized, time-resolved light transport between every projector pixel and every camera pixel.

Units, frames and signs follow Sunstone's ``CONVENTIONS.md``: metres, picoseconds, nanometres. Mueller matrices map Stokes vectors
in the projector's frame to Stokes vectors in the camera's frame.

Examples
--------
>>> import pysunstone as ps
>>> scene = ps.Scene.load("scenes/mirror_room/scene.toml")
>>> slices = scene.render(spp=16)
>>> slices["polarimetric"].arrays["mean"].shape  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pysunstone._cautions import SunstoneWarning
from pysunstone._native import InputError, RenderError, __version__

if TYPE_CHECKING:
    from pysunstone import apply, pbrdf, phase
    from pysunstone._view import View, view
    from pysunstone.builder import SceneBuilder
    from pysunstone.capture import Scheme, design_matrix, reconstruct, simulate
    from pysunstone.exposure import Exposure, exposure_for
    from pysunstone.learning import Learned, Materials, learn
    from pysunstone.mitsuba import from_mitsuba
    from pysunstone.mueller import decompose
    from pysunstone.scene import Layers, Scene, Slice, Slices, layers
    from pysunstone.shards import shard
    from pysunstone.stores import open_store

__all__ = [
    "Exposure",
    "InputError",
    "Layers",
    "Learned",
    "Materials",
    "RenderError",
    "Scene",
    "SceneBuilder",
    "Scheme",
    "Slice",
    "Slices",
    "SunstoneWarning",
    "View",
    "__version__",
    "apply",
    "decompose",
    "design_matrix",
    "exposure_for",
    "from_mitsuba",
    "layers",
    "learn",
    "open_store",
    "pbrdf",
    "phase",
    "reconstruct",
    "shard",
    "simulate",
    "view",
]

# Modules of the public names. Names load on first use, so that the command does not import NumPy and xarray.
_HOMES = {
    "Layers": "scene",
    "Exposure": "exposure",
    "Learned": "learning",
    "Materials": "learning",
    "Scene": "scene",
    "SceneBuilder": "builder",
    "Scheme": "capture",
    "Slice": "scene",
    "Slices": "scene",
    "decompose": "mueller",
    "design_matrix": "capture",
    "exposure_for": "exposure",
    "from_mitsuba": "mitsuba",
    "layers": "scene",
    "learn": "learning",
    "open_store": "stores",
    "reconstruct": "capture",
    "shard": "shards",
    "simulate": "capture",
    "View": "_view",
    "view": "_view",
}


_MODULES = ("apply", "pbrdf", "phase")


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{name}")
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, *_MODULES})
