"""Epipolar geometry of camera and projector: the projector pixels that can directly illuminate the point that a camera pixel
observes.

The essential matrix maps a camera pixel's normalized coordinates to a line on the projector's plane z = 1 (Hartley & Zisserman
2004, ch. 9). The focal lengths map that line to the projector's pixels.
"""

# pyright: basic
from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

__all__ = ["lines", "mask"]


_Numbers = npt.NDArray[np.float64]


def _device(device: Mapping[str, Any], name: str) -> tuple[_Numbers, _Numbers, _Numbers, _Numbers]:
    """Return the axes (columns), centre (metres), focal lengths and principal point (pixels) of a device."""
    if "pixels_per_m" in device:
        raise ValueError(f"the {name} is orthographic and has no centre of projection, so there are no epipolar lines")
    if any(device.get("distortion", {}).values()):
        raise ValueError(
            f"the lens of the {name} distorts, so epipolar lines are not straight: "
            "render a slice with `projector = { epipolar = { half_width_px = ... } }`, which includes the distortion"
        )
    axes = np.array([device[key] for key in ("right", "down", "forward")], dtype=float).T
    origin, focal, principal = (np.array(device[key], dtype=float) for key in ("origin_m", "focal_px", "principal_px"))
    return axes, origin, focal, principal


def lines(camera: Mapping[str, Any], projector: Mapping[str, Any], y: npt.ArrayLike, x: npt.ArrayLike) -> _Numbers:
    """Return the epipolar lines of camera pixels on the projector: a·u + b·v + c is the distance from the centre of pixel (v, u).

    Parameters
    ----------
    camera, projector
        Devices, as in the root attributes `camera` and `projector` of a store.
    y, x
        Pixel indices of the camera. Coordinates of bins yield the line of the bin's centre.

    Returns
    -------
    array of shape (y, x, 3)
        a, b, c with a² + b² = 1.
    """
    camera_axes, camera_origin, camera_focal, camera_principal = _device(camera, "camera")
    axes, origin, focal, principal = _device(projector, "projector")
    baseline = origin - camera_origin
    if np.linalg.norm(baseline) < 1e-9:
        raise ValueError("camera and projector are at the same position, so there are no epipolar lines")
    a, b, c = baseline / np.linalg.norm(baseline)
    essential = axes.T @ np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]) @ camera_axes
    seen_y = (np.asarray(y, dtype=float) + 0.5 - camera_principal[1]) / camera_focal[1]
    seen_x = (np.asarray(x, dtype=float) + 0.5 - camera_principal[0]) / camera_focal[0]
    seen = np.stack([*np.broadcast_arrays(seen_x[None, :], seen_y[:, None]), np.ones((seen_y.size, seen_x.size))], axis=-1)
    line = seen @ essential.T
    slope = line[..., :2] / focal
    offset = line[..., 2] + slope @ (0.5 - principal)
    found: _Numbers = np.concatenate([slope, offset[..., None]], axis=-1) / np.linalg.norm(slope, axis=-1, keepdims=True)
    return found


def mask(data: xr.DataArray, camera: Mapping[str, Any], projector: Mapping[str, Any], half_width_px: float) -> xr.DataArray:
    """Return a mask over (y, x, v, u): whether the projector pixel is within ``half_width_px`` of the camera pixel's epipolar
    line.

    Raises
    ------
    ValueError
        If the array does not keep camera and projector pixels separate, or a lens distorts.
    """
    kept = ("y", "x", "v", "u")
    if missing := [d for d in kept if d not in data.dims]:
        raise ValueError(
            f'the slice has no axis `{missing[0]}`: an epipolar sum requires s and s\' (`camera = "all"`, `projector = "all"`), '
            "or render epipolar light (`projector = { epipolar = { half_width_px = 1.5 } }`)"
        )
    if any(n != 1 for n in data.attrs.get("projector_bin", (1, 1))) or data.attrs.get("pixels_per_element", 1) != 1:
        raise ValueError("the slice has bins of pixels, and each bin spans several epipolar lines: render single pixels, or an epipolar slice")
    found = lines(camera, projector, data["y"].values, data["x"].values)
    at = {"y": data["y"], "x": data["x"]}
    a, b, c = (xr.DataArray(found[..., k], dims=("y", "x"), coords=at) for k in range(3))
    rows, columns = (xr.DataArray(data[d].values, dims=d, coords={d: data[d]}) for d in ("v", "u"))
    if data.chunks is not None:
        # The mask is lazy if the array is lazy, with the same chunks, because the mask may exceed the memory.
        cuts: dict[Hashable, tuple[int, ...]] = {d: data.chunksizes[d] for d in kept}
        a, b, c, rows, columns = (part.chunk({d: cuts[d] for d in part.dims}) for part in (a, b, c, rows, columns))
    return abs(a * columns + b * rows + c) <= half_width_px
