"""Draws slices with matplotlib: Mueller images in the layout of the paper, and time profiles with error bands.

Matplotlib is imported when the first plot is drawn.
"""

# pyright: basic
from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from . import _display

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["plot", "plot_mueller", "plot_profile", "to_rgb"]

#: Colour of undefined values.
_UNDEFINED = "#808080"
#: Resolution of figures, with which small labels can be read in notebooks and on pages.
_DPI = 150
#: Quantile of the values that is used as the end of a scale.
_WHITE = 0.99
#: Largest difference between a requested wavelength and a wavelength of the slice, in nanometres.
_SAME_NM = 0.5
#: Steepness of the arctan scale: arctan(_STEEP v / limit) / arctan(_STEEP), as in Baek & Heide (2021).
_STEEP = 8.0
#: Smallest distance between two ticks of the arctan scale, as a fraction of the colour bar.
_CLOSEST = 0.05
#: Largest number of lines in one plot.
_LINES = 12
#: Font size of the value label, and mean width of its characters relative to the font size.
_LABEL_PT, _PER_CHARACTER = 7, 0.6


def lane(available: Any, wavelength: float) -> int:
    """Return the index of a wavelength in nanometres, which must be one of those available."""
    distances = np.abs(np.atleast_1d(np.asarray(available, dtype=float)) - wavelength)
    # The comparison is false for NaN.
    if not (distances <= _SAME_NM).any():
        known = ", ".join(f"{nm:g}" for nm in np.atleast_1d(available))
        raise ValueError(f"wavelength {wavelength:g} nm does not exist: choose from {known} nm")
    return int(distances.argmin())


def _at_wavelength(data: xr.DataArray, wavelength: float | None) -> xr.DataArray:
    """Select one wavelength: the given one, or by default the middle one."""
    if "wavelength" not in data.dims:
        if wavelength is not None and "wavelength" in data.coords:
            lane(data["wavelength"].values, wavelength)
        return data
    if wavelength is None:
        return data.isel(wavelength=(data.sizes["wavelength"] - 1) // 2)
    return data.isel(wavelength=lane(data["wavelength"].values, wavelength))


def _arctan_ticks(limit: float) -> list[float]:
    """Return ticks between ± `limit`: 0, and 1, 2 or 5 times powers of ten that are not too close on the arctan scale."""
    decade = int(np.floor(np.log10(limit * (1 + 1e-6))))
    kept: list[float] = []
    for value in (m * 10.0**e for e in range(decade, decade - 3, -1) for m in (5, 2, 1)):
        if not 0.04 <= value / limit <= 1 + 1e-6:
            continue
        places = [0.5 * np.arctan(_STEEP * v / limit) / np.arctan(_STEEP) for v in (*kept[-1:], value)]
        if len(places) < 2 or places[0] - places[1] >= _CLOSEST:
            kept.append(value)
    return [*(-v for v in kept), 0.0, *reversed(kept)]


def to_rgb(data: xr.DataArray, white: float | None = None, linear: bool = False) -> npt.NDArray[Any]:
    """Return the photograph of M00 of an array, (rows, columns, 3), red first; see `pysunstone.Slice.to_rgb`."""
    nm = data["wavelength"].values.ravel().tolist() if "wavelength" in data.coords else None
    return _display.to_rgb(data.values, [str(d) for d in data.dims], nm, white, linear)


def plot(data: xr.DataArray, std_error: xr.DataArray | None = None, **options: Any) -> Any:
    """Draw an array in the way that its axes allow.

    - With camera pixels and Mueller matrices: the matrices as a grid of images, summed over all further axes.
    - With camera pixels otherwise: a photograph of M00.
    - With time bins: the time profile, summed over all further axes except the wavelength.

    Parameters
    ----------
    data, std_error
        Values of a slice, and their standard errors.
    **options
        Options of `plot_mueller`, or of `plot_profile`.

    Returns
    -------
    matplotlib.figure.Figure or matplotlib.axes.Axes
    """
    full = data.sizes.get("stokes_out") == 4 and data.sizes.get("stokes_in") == 4
    if {"y", "x"} <= set(data.dims):
        kept = ["y", "x", "stokes_out", "stokes_in", "wavelength"]
        if full:
            return plot_mueller(_summed(data, kept), **options)
        return _photograph(data, **options)
    if "t" in data.dims:
        kept = ["t", "stokes_out", "stokes_in", "wavelength"]
        return plot_profile(_summed(data, kept), None if std_error is None else _in_quadrature(std_error, kept), **options)
    raise ValueError(f"the array has the axes {', '.join(map(str, data.dims))}: plot needs y and x, or t; select or sum")


def _summed(data: xr.DataArray, kept: list[str]) -> xr.DataArray:
    return data.sum([d for d in data.dims if d not in kept], keep_attrs=True)


def _in_quadrature(errors: xr.DataArray, kept: list[str]) -> xr.DataArray:
    """Return errors of sums: over camera pixels in quadrature, over other axes as the bound for any correlation."""
    bound = errors.sum([d for d in errors.dims if d not in (*kept, "y", "x")], keep_attrs=True)
    pixels = [d for d in ("y", "x") if d in bound.dims and d not in kept]
    return (bound.astype(float) ** 2).sum(pixels, keep_attrs=True) ** 0.5 if pixels else bound


def _photograph(data: xr.DataArray, figsize: tuple[float, float] | None = None, white: float | None = None) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(dpi=_DPI, figsize=figsize or (4.2, 4.2 * data.sizes["y"] / data.sizes["x"]), layout="constrained")
    panel = figure.subplots()
    panel.imshow(to_rgb(data, white), interpolation="nearest")
    panel.set_axis_off()
    return figure


def plot_mueller(
    data: xr.DataArray,
    *,
    wavelength: float | None = None,
    normalized: bool = True,
    limit: float | None = None,
    scale: Literal["arctan", "linear"] | None = None,
    std_error: xr.DataArray | None = None,
    mask: float | None = None,
    figsize: tuple[float, float] | None = None,
) -> Figure:
    """Draw the sixteen elements of Mueller matrices as a 4 × 4 grid of images: rows Stokes out, columns Stokes in.

    Parameters
    ----------
    data
        Values over `stokes_out`, `stokes_in` and two image axes (`y` and `x`, or any others). Select or sum all further axes
        except the wavelength.
    wavelength
        Wavelength in nanometres, at most 0.5 nm from a wavelength of the array. Default: the middle wavelength.
    normalized
        Show M00 as intensity, and every other element divided by M00. Otherwise show all sixteen elements on one signed scale.
    limit
        Value at the ends of the signed scale, which is symmetric around 0. By default 1, or without `normalized` the 99th
        percentile of the magnitudes.
    scale
        Scale of the signed elements: `"linear"`, or `"arctan"`, which shows small values: arctan(8 v / limit) / arctan(8), as in
        Baek & Heide (2021). Default: `"arctan"` if normalized, otherwise `"linear"`.
    std_error
        Standard errors over the same axes as `data`.
    mask
        Draw signed elements whose magnitude is below this number of standard errors in grey; requires `std_error`. The standard
        error of a normalized element is that of the element, divided by M00. `None` or 0: no mask.
    figsize
        Width and height of the figure, inches.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib import colormaps, colors
    from matplotlib.figure import Figure

    chosen = _at_wavelength(data, wavelength).squeeze()
    image = [d for d in chosen.dims if d not in ("stokes_out", "stokes_in")]
    if not {"stokes_out", "stokes_in"} <= set(chosen.dims) or chosen.sizes["stokes_out"] != 4 or chosen.sizes["stokes_in"] != 4:
        raise ValueError("the array contains no Mueller matrices: the axes `stokes_out` and `stokes_in` must have four entries each")
    if len(image) != 2:
        raise ValueError(f"an image has two axes, but the array has {image}: select entries of the other axes, or sum over them")
    if scale not in (None, "arctan", "linear"):
        raise ValueError(f"unknown scale `{scale}`: choose from arctan, linear")
    is_arctan = scale == "arctan" or (scale is None and normalized)
    values = chosen.transpose("stokes_out", "stokes_in", *image).values.astype(float)
    intensity = values[0, 0]
    masked = np.zeros(values.shape, dtype=bool)
    if mask is not None and mask != 0:
        if not (mask > 0 and np.isfinite(mask)):
            raise ValueError(f"mask must be a positive number of standard errors, or 0 or None for no mask, got {mask}")
        if std_error is None:
            raise ValueError("mask requires standard errors: pass std_error, or mask=None")
        error = _at_wavelength(std_error, wavelength).squeeze()
        if set(error.dims) != set(chosen.dims) or any(error.sizes[d] != chosen.sizes[d] for d in chosen.dims):
            raise ValueError(f"std_error has the axes {dict(error.sizes)}, but the values have the axes {dict(chosen.sizes)}")
        least = mask * error.transpose("stokes_out", "stokes_in", *image).values.astype(float)
        # An element whose standard error is not finite is also masked.
        masked = ~(np.abs(values) >= least)
    if normalized:
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.where(intensity > 0, values / intensity, np.nan)
    sizes = np.abs(values[np.isfinite(values)])
    end = limit if limit is not None else 1.0 if normalized else float(np.quantile(sizes, _WHITE)) if sizes.size else 1.0
    signed = colormaps["RdBu_r"].with_extremes(bad=_UNDEFINED)
    figure = Figure(dpi=_DPI, figsize=figsize or (7.2, 6.4), layout="constrained")
    panels = figure.subplots(4, 4, sharex=True, sharey=True)
    drawn = None
    end = end or 1.0
    if is_arctan:
        norm: colors.Normalize = colors.FuncNorm(
            (lambda v: np.arctan(_STEEP * v / end), lambda v: np.tan(v) * end / _STEEP), vmin=-end, vmax=end
        )
    else:
        norm = colors.Normalize(-end, end)
    values = np.where(masked, np.nan, values)
    for i in range(4):
        for j in range(4):
            panel = panels[i, j]
            if normalized and i == j == 0:
                lit = intensity[np.isfinite(intensity)]
                white = float(np.quantile(lit, _WHITE)) if lit.size else 1.0
                panel.imshow(intensity, cmap="gray", vmin=0, vmax=white or 1.0, interpolation="nearest")
            else:
                drawn = panel.imshow(values[i, j], cmap=signed, norm=norm, interpolation="nearest")
            panel.set(xticks=[], yticks=[])
            panel.set_title(f"M{i}{j}", fontsize=7, pad=2)
    label = "Mij / M00" if normalized else f"Mij [{data.attrs.get('units', '1')}]"
    if is_arctan:
        label += ", arctan scale"
    assert drawn is not None
    if is_arctan:
        ticks = _arctan_ticks(end)
        bar = figure.colorbar(drawn, ax=panels, label=label, shrink=0.6, ticks=ticks)
        bar.set_ticks(ticks, labels=[f"{v:g}" for v in ticks])
        bar.minorticks_off()
    else:
        figure.colorbar(drawn, ax=panels, label=label, shrink=0.6)
    title = [f"{float(chosen['wavelength']):g} nm"] if "wavelength" in chosen.coords else []
    if masked.any():
        title.append(f"grey: below {mask:g} standard errors")
    if title:
        figure.suptitle("; ".join(title), fontsize=9)
    return figure


def plot_profile(
    mean: xr.DataArray,
    std_error: xr.DataArray | None = None,
    *,
    wavelength: float | None = None,
    sigmas: float = 1.0,
    ax: Axes | None = None,
    **line: Any,
) -> Axes:
    """Draw a time profile with an error band of `sigmas` standard errors.

    Parameters
    ----------
    mean
        Values over `t` and at most one other axis, each entry of which becomes a line. For Mueller matrices, M00 is drawn.
    std_error
        Standard errors over the same axes.
    wavelength
        Wavelength in nanometres, at most 0.5 nm from a wavelength of the array. By default, each wavelength is a line if wavelength
        is the only other axis.
    sigmas
        Half width of the band, in standard errors.
    ax
        Axes to draw on; by default new ones.
    **line
        Options of `matplotlib.axes.Axes.plot`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    from matplotlib.figure import Figure

    if ax is None:
        ax = Figure(dpi=_DPI, figsize=(5, 3.2), layout="constrained").subplots()

    def chosen(data: xr.DataArray) -> xr.DataArray:
        if "stokes_in" in data.dims:
            data = data.isel(stokes_in=0, stokes_out=0) if "stokes_out" in data.dims else data.isel(stokes_in=0)
        if wavelength is not None:
            data = _at_wavelength(data, wavelength)
        squeezable = [d for d in data.dims if d != "t" and data.sizes[d] == 1]
        return data.squeeze(squeezable)

    mean = chosen(mean)
    if "t" not in mean.dims:
        raise ValueError("the slice does not resolve time: render a slice with time bins")
    others = [d for d in mean.dims if d != "t"]
    if len(others) > 1 or (others and mean.sizes[others[0]] > _LINES):
        raise ValueError(f"a profile has `t` and at most one other axis of up to {_LINES} entries, found {others}: select or sum")
    error = None if std_error is None else chosen(std_error)
    times = mean["t"].values
    for k in range(mean.sizes[others[0]] if others else 1):
        pick: dict[Any, int] = {others[0]: k} if others else {}
        value = mean.isel(pick).values
        label = None
        if others:
            coordinate = mean[others[0]]
            units = coordinate.attrs.get("units", "1")
            label = f"{others[0]} {coordinate.values[k]:g}" + ("" if units == "1" else f" {units}")
        (drawn,) = ax.plot(times, value, **{"drawstyle": "steps-mid", "linewidth": 1, "label": label, **line})
        if error is not None:
            half = sigmas * error.isel(pick).values
            ax.fill_between(times, value - half, value + half, step="mid", color=drawn.get_color(), alpha=0.3, linewidth=0)
    if others:
        ax.legend(fontsize=7)
    ax.set_xlabel(f"travel time [{mean['t'].attrs.get('units', 'ps')}]")
    # Wrap long names of quantities to the height of the plot.
    figure = ax.get_figure(root=True)
    inches = ax.get_window_extent().height / figure.dpi if figure else 2.5
    width = max(20, int(inches * 72 / (_LABEL_PT * _PER_CHARACTER)))
    name = f"{mean.attrs.get('long_name', 'value')} [{mean.attrs.get('units', '1')}]"
    ax.set_ylabel("\n".join(textwrap.wrap(name, width)), fontsize=_LABEL_PT)
    return ax
