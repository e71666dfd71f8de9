"""Epipolar geometry of camera and projector: which projector pixels can light directly what a camera pixel sees.

The essential matrix takes a camera pixel's normalized coordinates to a line on the projector's plane z = 1 (Hartley & Zisserman
2004, ch. 9), and the focal lengths take that line to the projector's pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

__all__ = ["distances", "mask"]


_Numbers = npt.NDArray[np.float64]


def _device(device: Mapping[str, Any], name: str) -> tuple[_Numbers, _Numbers, _Numbers, _Numbers]:
    """Axes as columns, centre, focal lengths, principal point."""
    if any(device.get("distortion", {}).values()):
        raise ValueError(
            f"the lens of the {name} distorts, and lines are not straight: "
            "render a slice with `projector = { epipolar = { half_width_px = ... } }`, which knows the distortion"
        )
    axes = np.array([device[key] for key in ("right", "down", "forward")], dtype=float).T
    origin, focal, principal = (np.array(device[key], dtype=float) for key in ("origin_m", "focal_px", "principal_px"))
    return axes, origin, focal, principal


def distances(
    camera: Mapping[str, Any], projector: Mapping[str, Any], y: npt.ArrayLike, x: npt.ArrayLike, v: npt.ArrayLike, u: npt.ArrayLike
) -> npt.NDArray[np.float64]:
    """Distances of the centres of projector pixels (v, u) from the epipolar lines of camera pixels (y, x), projector pixels.

    Parameters
    ----------
    camera, projector
        Devices as the root attributes `camera` and `projector` of a store state them.
    y, x, v, u
        Pixel indices; those of bins' middles give the distances of these.

    Returns
    -------
    array of shape (y, x, v, u)
    """
    camera_axes, camera_origin, camera_focal, camera_principal = _device(camera, "camera")
    axes, origin, focal, principal = _device(projector, "projector")
    baseline = origin - camera_origin
    if np.linalg.norm(baseline) < 1e-9:
        raise ValueError("camera and projector are in one place: there are no epipolar lines")
    a, b, c = baseline / np.linalg.norm(baseline)
    essential = axes.T @ np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]) @ camera_axes
    seen_y = (np.asarray(y, dtype=float) + 0.5 - camera_principal[1]) / camera_focal[1]
    seen_x = (np.asarray(x, dtype=float) + 0.5 - camera_principal[0]) / camera_focal[0]
    seen = np.stack([*np.broadcast_arrays(seen_x[None, :], seen_y[:, None]), np.ones((seen_y.size, seen_x.size))], axis=-1)
    line = seen @ essential.T
    slope = line[..., :2] / focal
    line = np.concatenate([slope, line[..., 2:]], axis=-1) / np.linalg.norm(slope, axis=-1, keepdims=True)
    columns = np.asarray(u, dtype=float) + 0.5 - principal[0]
    rows = np.asarray(v, dtype=float) + 0.5 - principal[1]
    offset: npt.NDArray[np.float64] = np.abs(
        line[..., 0, None, None] * columns[None, :] + line[..., 1, None, None] * rows[:, None] + line[..., 2, None, None]
    )
    return offset


def mask(data: xr.DataArray, camera: Mapping[str, Any], projector: Mapping[str, Any], half_width_px: float) -> xr.DataArray:
    """True where a projector pixel lies within so many pixels of the epipolar line of the camera pixel, over (y, x, v, u).

    Raises
    ------
    ValueError
        If the array does not keep camera and projector pixels apart, or a lens distorts.
    """
    kept = ("y", "x", "v", "u")
    if missing := [d for d in kept if d not in data.dims]:
        raise ValueError(
            f'the slice has no axis `{missing[0]}`: epipolar light is told by s and s\' (`camera = "all"`, `projector = "all"`), '
            "or rendered (`projector = { epipolar = { half_width_px = 1.5 } }`)"
        )
    if any(n != 1 for n in data.attrs.get("projector_bin", (1, 1))) or data.attrs.get("pixels_per_element", 1) != 1:
        raise ValueError("the slice has bins of pixels, which lie on several lines: render single pixels, or an epipolar slice")
    coords = [data[d].values for d in kept]
    return xr.DataArray(
        distances(camera, projector, *coords) <= half_width_px, dims=kept, coords={d: data[d] for d in kept}
    )
