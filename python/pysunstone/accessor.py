"""The xarray accessor `.sunstone`: probe, decompose, capture and draw slices.

Importing this module registers the accessor; `pysunstone.open_store` imports it. On a `DataArray` it computes values only. On a
`Dataset` (a slice: `mean`, `std_error`, ...) it also propagates standard errors.
"""

# pyright: basic
from __future__ import annotations

import os
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from . import epipolar as geometry
from . import plots
from .contraction import Errors, contracted, summed
from .polarimetry import SchemeLike, captured, decomposed, reconstructed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["SunstoneArray", "SunstoneDataset", "SunstoneTree"]

Kind = Literal["total", "linear", "circular"]


def _polarized(data: xr.DataArray, kind: Kind) -> tuple[list[xr.DataArray], xr.DataArray]:
    """Return the Stokes elements of the polarized component, and the intensity."""
    if "stokes_in" in data.dims:
        raise ValueError("the array contains Mueller matrices: choose the light with probe(state=...) first")
    if "stokes_out" not in data.dims or data.sizes["stokes_out"] != 4:
        raise ValueError("the axis `stokes_out` must have four entries: render a slice with polarization `mueller`")
    which = {"total": (1, 2, 3), "linear": (1, 2), "circular": (3,)}
    if kind not in which:
        raise ValueError(f"unknown degree of polarization `{kind}`: choose from {', '.join(which)}")
    data = data.astype(float)
    return [data.isel(stokes_out=i, drop=True) for i in which[kind]], data.isel(stokes_out=0, drop=True)


def _size(parts: list[xr.DataArray]) -> xr.DataArray:
    squares = parts[0] ** 2
    for part in parts[1:]:
        squares = squares + part**2
    return squares**0.5


def _degree(data: xr.DataArray, kind: Kind) -> xr.DataArray:
    parts, intensity = _polarized(data, kind)
    size = _size(parts)
    result: xr.DataArray = size / intensity.where(intensity > 0)
    return result.astype(np.float32).assign_attrs(units="1", long_name=f"degree of {kind} polarization")


@xr.register_dataarray_accessor("sunstone")  # type: ignore[no-untyped-call]
class SunstoneArray:
    """Operations on an array of values of a slice.

    Parameters
    ----------
    data
        The array.
    """

    def __init__(self, data: xr.DataArray) -> None:
        self._data = data

    def probe(
        self,
        pattern: npt.ArrayLike | None = None,
        state: str | npt.ArrayLike | None = None,
        pulse: float | npt.ArrayLike | None = None,
        *,
        sum: Iterable[Hashable] = (),
    ) -> xr.DataArray:
        """Contract with the projector's light: I = Σ T P over s' and p', then convolve with a pulse along t, then sum.

        Parameters
        ----------
        pattern
            Drive of every projector pixel, 0 to 1, or a mask, of shape (rows, columns) of the projector. Shape (K, rows, columns)
            gives K patterns in one call, along a new axis `pattern`. A pattern contracts `v` and `u`.
        state
            Stokes vector of the projector's light: a name (``"unpolarized"``, ``"horizontal"``, ``"vertical"``, ``"plus45"``,
            ``"minus45"``, ``"right"``, ``"left"``), four numbers, or an array (K, 4) for K states along a new axis `state`. A
            state contracts `stokes_in`; along `stokes_out`, the result is the Stokes vector at the camera.
        pulse
            Full width at half maximum of a Gaussian pulse in picoseconds, or samples of a pulse at the slice's bin width. Light
            that the pulse moves out of the bins is lost (a data set keeps it as `shifted_out`).
        sum
            Axes to sum over.

        Returns
        -------
        xarray.DataArray
            float32 over the remaining axes; lazy if the array is lazy.

        Raises
        ------
        ValueError
            If the slice does not have an axis to contract.

        Notes
        -----
        Call `probe` before you select entries along `t`, because a pulse treats removed bins as dark.
        """
        return summed(contracted(self._data, pattern, state, pulse, None)[0], sum, None)

    def epipolar(
        self, half_width_px: float = 1.5, *, camera: Mapping[str, Any], projector: Mapping[str, Any], inside: bool = True
    ) -> xr.DataArray:
        """Sum along epipolar lines, as `SunstoneDataset.epipolar`.

        An array alone does not store the devices: pass the attributes `camera` and `projector` of the store.
        """
        chosen = geometry.mask(self._data, camera, projector, half_width_px)
        kept = self._data.where(chosen if inside else ~chosen, 0)
        return summed(kept.assign_attrs(self._data.attrs), ("v", "u"), None)

    def degree_of_polarization(self, kind: Kind = "total") -> xr.DataArray:
        """Return the degree of polarization of the light at the camera, √(s1² + s2² + s3²)/s0.

        Parameters
        ----------
        kind
            ``"total"``, ``"linear"`` (s1 and s2) or ``"circular"`` (|s3|).

        Returns
        -------
        xarray.DataArray
            Without the axis `stokes_out`; NaN for pixels without light. Noise biases the degree upwards in dark pixels.
        """
        return _degree(self._data, kind)

    def decompose(self, only: Sequence[str] | None = None) -> xr.Dataset:
        """Decompose Mueller matrices after Lu and Chipman, M = M_Δ M_R M_D, as `sunstone decompose`.

        Parameters
        ----------
        only
            Names of the arrays to return: `polarizance`, `diattenuation`, `retardance`, `depolarization`, `retardance_axis`,
            `m_delta`, `m_r`, `m_d` (all of these by default), or `entropy` (Cloude).

        Returns
        -------
        xarray.Dataset
            NaN for matrices that are not realizable. The method of a `Dataset` also returns standard errors of the four scalars
            (``NAME_std_error``).
        """
        return decomposed(self._data, None, only)

    def capture(
        self,
        scheme: SchemeLike,
        detector: Mapping[str, Any] | str | os.PathLike[str] | None = None,
        *,
        noise: float | None = None,
        relative_noise: float | None = None,
        seed: int = 0,
    ) -> xr.Dataset:
        """Simulate the captures of these Mueller matrices by a rig with a capture scheme, as `sunstone capture`.

        Parameters
        ----------
        scheme
            Scheme file, such as `sunstone scheme drr` writes, or an object with `to_toml()`, such as `pysunstone.Scheme`.
        detector
            Detector file, or its content as a dict; `pysunstone.simulate` lists the keys and their units. A camera (``cmos``) also
            gives variances. A photon counter (``spad``) requires slices over `y`, `x` and `t`.
        noise, relative_noise
            Standard deviation of Gaussian noise, in the unit of the matrices or relative to the mean M00.
        seed
            Seed of the noise.

        Returns
        -------
        xarray.Dataset
            `mean` over `capture` (and `channel` for a polarizer array) and the array's axes, in the unit of the matrices; with a
            camera also `variance`, in the squared unit of the matrices. Electrons and digital numbers are converted back to the unit
            of the matrices; see the notes of `pysunstone.simulate`. Saturated intensities are NaN.
        """
        return captured(self._data, scheme, detector, noise, relative_noise, seed)

    def reconstruct(
        self,
        scheme: SchemeLike,
        *,
        variance: xr.DataArray | None = None,
        noise: float | None = None,
        saturation: float | None = None,
        realizable: bool = False,
        errors: bool = True,
        prior: Any = None,
    ) -> xr.Dataset:
        """Reconstruct Mueller matrices from captures by least squares or with a prior, as `sunstone reconstruct`.

        Parameters
        ----------
        scheme
            Scheme of the captures, as for `capture`.
        variance
            Variances of the intensities, in the squared unit of the intensities, used as weights.
        noise
            Standard deviation of the intensities' noise, in the unit of the intensities.
        saturation
            Intensities at or above this value, in the unit of the intensities, are excluded. NaN intensities are always excluded.
        realizable
            Replace each matrix by the nearest realizable one (Cloude).
        errors
            Propagate errors from `variance` or `noise`; without these, from the residuals of the fit, which requires more than 16
            measurements.
        prior
            Second moment of the expected matrices, (16, 16), or its file; requires `noise`.

        Returns
        -------
        xarray.Dataset
            `mean` and, with `errors`, `std_error`, over the captures' axes, `stokes_out` and `stokes_in`, in the unit of the
            intensities.
        """
        return reconstructed(self._data, scheme, variance, noise, saturation, realizable, errors, prior)

    def to_rgb(self, white: float | None = None, *, linear: bool = False) -> npt.NDArray[Any]:
        """Return the photograph of M00, (rows, columns, 3), red first; see `pysunstone.Slice.to_rgb`."""
        return plots.to_rgb(self._data, white, linear)

    def plot(self, **options: Any) -> Any:
        """Draw the array; see `pysunstone.plots.plot`."""
        return plots.plot(self._data, **options)

    def plot_mueller(self, **options: Any) -> Figure:
        """Draw the sixteen elements as a grid of images; see `pysunstone.plots.plot_mueller`."""
        return plots.plot_mueller(self._data, **options)

    def plot_profile(self, **options: Any) -> Axes:
        """Draw a time profile; see `pysunstone.plots.plot_profile`."""
        return plots.plot_profile(self._data, **options)


@xr.register_dataset_accessor("sunstone")  # type: ignore[no-untyped-call]
class SunstoneDataset:
    """Operations on a slice: values with standard errors.

    Parameters
    ----------
    data
        The slice, with `mean` and, for errors, `std_error`.
    """

    def __init__(self, data: xr.Dataset) -> None:
        self._data = data

    def _fields(self) -> list[tuple[str, xr.DataArray, bool]]:
        """Return the arrays of the slice: name, values, and whether they are standard errors. Arrays without standard errors are
        included.
        """
        if "mean" not in self._data:
            raise ValueError("the data set is not a slice of a store: the array `mean` is missing")
        known = (("mean", False), ("std_error", True), ("overflow", False), ("overflow_std_error", True))
        return [(name, self._data[name], error) for name, error in known if name in self._data]

    def probe(
        self,
        pattern: npt.ArrayLike | None = None,
        state: str | npt.ArrayLike | None = None,
        pulse: float | npt.ArrayLike | None = None,
        *,
        sum: Iterable[Hashable] = (),
        errors: Errors = "bound",
    ) -> xr.Dataset:
        """Contract with the projector's light, as `SunstoneArray.probe`, and propagate errors.

        Parameters
        ----------
        pattern, state, pulse, sum
            See `SunstoneArray.probe`.
        errors
            ``"bound"``: Σ|w|·se over the elements of a camera pixel, which are estimated from the same samples. This bound holds
            for any correlation, and `sunstone probe` reports it. ``"independent"``: √Σ(w·se)², which is too small if the elements
            are correlated. Over camera pixels, both options add errors in quadrature.

        Returns
        -------
        xarray.Dataset
            `mean` and `std_error`. If time is resolved, also `overflow`: the light outside the bins, with which the pulse is not
            convolved. With a pulse, also `shifted_out`: the light that the pulse moves out of the bins. `total_std_error` does
            not apply to the result and is omitted.
        """
        sum = list(sum)
        result: dict[str, xr.DataArray] = {}
        for name, data, is_error in self._fields():
            timeless = name.startswith("overflow")
            how = errors if is_error else None
            light, shifted = contracted(data, pattern, state, None if timeless else pulse, how)
            over = [d for d in sum if not (timeless and d == "t")]
            result[name] = summed(light, over, how)
            if shifted is not None and name == "mean":
                result["shifted_out"] = summed(shifted, [d for d in sum if d != "t"], None).assign_attrs(
                    long_name="light that the pulse moved out of the time bins"
                )
        return xr.Dataset(result, attrs=self._data.attrs)

    def epipolar(
        self,
        half_width_px: float = 1.5,
        *,
        camera: Mapping[str, Any] | None = None,
        projector: Mapping[str, Any] | None = None,
        inside: bool = True,
        errors: Errors = "bound",
    ) -> xr.Dataset:
        """Sum over the projector pixels within a distance of each camera pixel's epipolar line.

        Parameters
        ----------
        half_width_px
            Largest distance from the line, in projector pixels.
        camera, projector
            Devices, as in the store's root attributes; by default those of the slice.
        inside
            False: sum over all other pixels (non-epipolar light).
        errors
            See `probe`.

        Returns
        -------
        xarray.Dataset
            The slice without `v` and `u`.

        Raises
        ------
        ValueError
            If the slice does not keep single pixels of both devices, or if a lens distorts. Render an epipolar slice instead.
        """
        camera = camera or self._data.attrs.get("camera")
        projector = projector or self._data.attrs.get("projector")
        if camera is None or projector is None:
            raise ValueError("camera and projector are unknown: pass them, or open the store with pysunstone.open_store")
        result = {}
        chosen = None
        for name, data, is_error in self._fields():
            if chosen is None:
                chosen = geometry.mask(data, camera, projector, half_width_px)
            kept = data.where(chosen if inside else ~chosen, 0).assign_attrs(data.attrs)
            result[name] = summed(kept, ("v", "u"), errors if is_error else None)
        return xr.Dataset(result, attrs=self._data.attrs)

    def degree_of_polarization(self, kind: Kind = "total") -> xr.Dataset:
        """Return the degree of polarization of the light at the camera, as `SunstoneArray.degree_of_polarization`, with errors.

        Returns
        -------
        xarray.Dataset
            `mean` and `std_error`. The error is the first-order bound Σ|∂/∂s|·se, because the elements of a pixel share their
            samples.
        """
        mean = self._data["mean"]
        result = {"mean": _degree(mean, kind)}
        if "std_error" in self._data:
            parts, intensity = _polarized(mean, kind)
            errors, of_intensity = _polarized(self._data["std_error"], kind)
            size = _size(parts)
            # The degree is not differentiable if the polarized component is zero. In this case the error of the component's
            # magnitude is used.
            shares = [abs(part) / size.where(size > 0, 1) + (size == 0) for part in parts]
            intensity = intensity.where(intensity > 0)
            bound = sum(share * error for share, error in zip(shares, errors, strict=True)) / intensity
            bound = bound + size / intensity**2 * of_intensity
            result["std_error"] = bound.astype(np.float32).assign_attrs(units="1", long_name="standard error, bound")
        return xr.Dataset(result, attrs=self._data.attrs)

    def decompose(self, only: Sequence[str] | None = None) -> xr.Dataset:
        """Decompose Mueller matrices, as `SunstoneArray.decompose`, with standard errors of the scalars."""
        return decomposed(self._data["mean"], self._data.get("std_error"), only)

    def capture(
        self,
        scheme: SchemeLike,
        detector: Mapping[str, Any] | str | os.PathLike[str] | None = None,
        **options: Any,
    ) -> xr.Dataset:
        """Simulate the captures of `mean` by a rig; see `SunstoneArray.capture`."""
        return SunstoneArray(self._data["mean"]).capture(scheme, detector, **options)

    def reconstruct(self, scheme: SchemeLike, **options: Any) -> xr.Dataset:
        """Reconstruct Mueller matrices from captures `mean` and their `variance`, if present; see `SunstoneArray.reconstruct`."""
        if "variance" in self._data:
            options.setdefault("variance", self._data["variance"])
        return SunstoneArray(self._data["mean"]).reconstruct(scheme, **options)

    def to_rgb(self, white: float | None = None, *, linear: bool = False) -> npt.NDArray[Any]:
        """Return the photograph of M00 of `mean`, (rows, columns, 3), red first; see `pysunstone.Slice.to_rgb`."""
        return plots.to_rgb(self._data["mean"], white, linear)

    def plot(self, **options: Any) -> Any:
        """Draw the slice; see `pysunstone.plots.plot`."""
        return plots.plot(self._data["mean"], self._data.get("std_error"), **options)

    def plot_mueller(self, **options: Any) -> Figure:
        """Draw the sixteen elements of `mean` as a grid of images; see `pysunstone.plots.plot_mueller`.

        If the slice has standard errors, elements below two standard errors are grey. `mask=None` disables this mask.
        """
        if "std_error" in self._data:
            options = {"std_error": self._data["std_error"], "mask": 2.0, **options}
        return plots.plot_mueller(self._data["mean"], **options)

    def plot_profile(self, **options: Any) -> Axes:
        """Draw a time profile with its error band; see `pysunstone.plots.plot_profile`."""
        return plots.plot_profile(self._data["mean"], self._data.get("std_error"), **options)


@xr.register_datatree_accessor("sunstone")  # type: ignore[no-untyped-call]
class SunstoneTree(SunstoneDataset):
    """Operations on the tree node of a slice: the same as those on the slice's data set.

    Parameters
    ----------
    tree
        The node, such as ``open_store(...)["xt"]``.
    """

    def __init__(self, tree: xr.DataTree) -> None:
        super().__init__(tree.to_dataset())
