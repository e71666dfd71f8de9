"""Images and tables for notebooks."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _native

__all__ = ["block", "encoded", "picture", "row", "to_rgb"]

#: Axes of an image.
_IMAGE = ("y", "x")
#: Share of the values of a photograph that are below white.
_WHITE = 0.99
#: Minimum and maximum size of a thumbnail in CSS pixels.
_SMALL, _LARGE = 160, 320


def encoded(linear: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Return linear values of 0 to 1 as 8-bit sRGB values."""
    v = np.clip(np.nan_to_num(linear.astype(np.float32)), 0, 1)
    curve = np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(curve * 255), np.uint8)


def to_rgb(
    values: npt.NDArray[Any], dims: Sequence[str], wavelengths_nm: Sequence[float] | None, white: float | None, linear: bool
) -> npt.NDArray[Any]:
    """Return the photograph of a slice, (rows, columns, 3), red first.

    M00 is summed over all axes except rows, columns and wavelengths. Wavelengths are assigned to red, green and blue as in the
    photographs of the command. ``white`` is the value shown as white.
    """
    if any(axis not in dims for axis in _IMAGE):
        raise ValueError(f"the slice has the axes {', '.join(dims)}: a photograph needs y and x; render a slice that keeps camera pixels")
    data, left = values, list(dims)
    for axis in [d for d in dims if d.startswith("stokes_")]:
        data = data.take(0, left.index(axis))
        left.remove(axis)
    others = tuple(i for i, d in enumerate(left) if d not in (*_IMAGE, "wavelength"))
    data = data.sum(axis=others, dtype=np.float64)
    left = [d for d in left if d in (*_IMAGE, "wavelength")]
    image = data.transpose([left.index(d) for d in (*_IMAGE, "wavelength") if d in left])
    if image.ndim == 2:
        image = image[:, :, None]
    nm = [550.0] if wavelengths_nm is None else [float(w) for w in wavelengths_nm]
    weights = np.asarray(_native.rgb_weights(nm), np.float32)
    rgb = np.asarray(image.astype(np.float32) @ weights.T, np.float32)
    if linear:
        return rgb
    if white is None:
        lit = rgb[np.isfinite(rgb)]
        white = float(np.quantile(lit, _WHITE, method="nearest")) if lit.size else 1.0
        white = white if white > 0 else float(lit.max(initial=0)) or 1.0
    shown = encoded(rgb / np.float32(white))
    shown[~np.isfinite(rgb).all(-1)] = 178
    return shown


def picture(image: npt.NDArray[np.uint8], caption: str = "") -> str:
    """Return an 8-bit image as HTML, enlarged or reduced to the size of a thumbnail."""
    height, width = image.shape[:2]
    step = max(1, -(-max(height, width) // (2 * _LARGE)))
    png = base64.b64encode(_native.encode_image(np.ascontiguousarray(image[::step, ::step]))).decode()
    size = min(_LARGE, max(_SMALL, width))
    name = html.escape(caption)
    return (
        f'<figure style="display:inline-block;margin:4px"><img alt="{name}" style="width:{size}px;image-rendering:pixelated" '
        f'src="data:image/png;base64,{png}"/><figcaption style="font-size:smaller">{name}</figcaption></figure>'
    )


def row(key: str, value: object) -> str:
    """Return a row of a table."""
    style = "text-align:left;vertical-align:top"
    return f'<tr><th style="{style}">{html.escape(key)}</th><td style="{style}">{html.escape(str(value))}</td></tr>'


def block(title: str, pictures: Iterable[str], rows: Iterable[tuple[str, object]]) -> str:
    """Return a title, pictures and a table as HTML."""
    table = "".join(row(key, value) for key, value in rows)
    return f"<div><b>{html.escape(title)}</b><div>{''.join(pictures)}</div><table>{table}</table></div>"
