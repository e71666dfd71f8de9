"""Capture schemes of ellipsometers, simulated captures, and reconstruction of Mueller matrices from captures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import real, whole
from pysunstone._cautions import caution
from pysunstone import _display
from pysunstone._documents import json_of
from pysunstone._native import InputError

__all__ = ["Scheme", "design_matrix", "reconstruct", "simulate"]


class Scheme:
    """Settings of a rig's polarizing elements for each capture."""

    def __init__(self, native: _native.Scheme) -> None:
        self._native = native

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scheme:
        """Read a scheme file: CSV if the name ends in ``.csv``, else TOML."""
        return cls(_native.Scheme.load(path))

    @classmethod
    def from_toml(cls, text: str) -> Scheme:
        """Parse the text of a scheme file."""
        return cls(_native.Scheme.from_toml(text))

    @classmethod
    def drr(cls, captures: int = 36, *, polarizer_array: bool = False) -> Scheme:
        """Return the scheme of dual rotating retarders (Azzam 1978), which rotate by 5° and 25° per capture."""
        return cls._preset("drr", captures, polarizer_array)

    @classmethod
    def qrpr(cls, captures: int = 36, *, polarizer_array: bool = False) -> Scheme:
        """Return a scheme of four rotating elements (two polarizers and two retarders) at hand-chosen angles."""
        return cls._preset("qrpr", captures, polarizer_array)

    @classmethod
    def lc(cls, captures: int = 16, *, polarizer_array: bool = False) -> Scheme:
        """Return a scheme with two liquid-crystal retarders each before and behind the scene."""
        return cls._preset("lc", captures, polarizer_array)

    @classmethod
    def _preset(cls, name: str, captures: int, polarizer_array: bool) -> Scheme:
        made = cls(_native.Scheme.preset(name, whole("captures", captures, 1), polarizer_array))
        rank = made.quality()["rank"]
        if rank < 16:
            caution(
                [
                    f"the scheme {made.name} has rank {rank:.0f} of 16 and does not determine a Mueller matrix; use at least "
                    f"{made._native.least_captures} captures, or reconstruct with a prior"
                ]
            )
        return made

    def to_toml(self) -> str:
        """Return the scheme as the text of its file."""
        return self._native.to_toml()

    @property
    def name(self) -> str:
        """Name of the scheme."""
        return self._native.name

    @property
    def captures(self) -> int:
        """Number of captures."""
        return self._native.captures

    @property
    def channels(self) -> int:
        """Number of values per pixel and capture: 1, or 4 for a polarizer array (0°, 45°, 90°, 135°)."""
        return self._native.channels

    @property
    def bound(self) -> float:
        """Lower bound of ``error_variance`` (see `quality`) for the scheme's number of captures, without a unit."""
        return self._native.bound

    def quality(self, wavelength_nm: float = 550.0) -> dict[str, float]:
        """Return ``rank``, ``condition`` number and ``error_variance``, which have no unit.

        ``error_variance`` is the sum of the variances of the 16 elements, relative to the variance of an intensity. If all intensities
        have the variance σ², the root mean square error of an element is σ·√(error_variance/16), in the unit of σ.
        """
        rank, condition, variance = self._native.quality(wavelength_nm)
        return {"rank": rank, "condition": condition, "error_variance": variance}

    def __repr__(self) -> str:
        channels = "" if self.channels == 1 else f", {self.channels} channels"
        return f"<pysunstone.Scheme {self.name!r}, {self.captures} captures{channels}>"

    def _repr_html_(self) -> str:
        quality = self.quality()
        rows = [
            ("captures", self.captures),
            ("values per pixel and capture", self.channels),
            ("rank at 550 nm", f"{quality['rank']:.0f} of 16"),
            ("condition number", f"{quality['condition']:.4g}"),
            ("error variance, and its lower bound", f"{quality['error_variance']:.4g}, {self.bound:.4g}"),
        ]
        return _display.block(f"Scheme {self.name}", [self._picture()], rows)

    def _picture(self) -> str:
        """Return an image of the design matrix: a row for each measurement, a column for each Mueller element."""
        a = design_matrix(self)
        share = a / max(float(np.abs(a).max()), 1e-30)
        fade = 1 - np.abs(share)
        red, blue = np.where(share < 0, fade, 1.0), np.where(share > 0, fade, 1.0)
        image = np.stack([red, fade, blue], -1)
        return _display.picture(np.rint(image * 255).astype(np.uint8), "design matrix: measurements x elements (red > 0, blue < 0)")


def design_matrix(
    scheme: Scheme, wavelength_nm: float = 550.0, *, incidence_deg: float = 0.0, azimuth_deg: float = 0.0
) -> npt.NDArray[np.float64]:
    """Return the design matrix A of a scheme, (captures × channels, 16): intensities are ``A @ M.reshape(16)``.

    A has no unit, so intensities are in the unit of the Mueller matrices M. A polarizer transmits half of unpolarized light: with
    ideal polarizers in front of the projector and of the camera, ``A[:, 0]`` is 1/4, and no entry of A has a larger absolute value.

    Parameters
    ----------
    scheme
        Capture scheme.
    wavelength_nm
        Vacuum wavelength in nanometres.
    incidence_deg, azimuth_deg
        Direction of the light relative to the optical axis, in degrees.
    """
    return scheme._native.design_matrix(wavelength_nm, incidence_deg, azimuth_deg)  # pyright: ignore[reportPrivateUsage]


def _measured(scheme: Scheme) -> tuple[int, ...]:
    return (scheme.captures,) if scheme.channels == 1 else (scheme.captures, scheme.channels)


def _lanes(wavelengths_nm: float | Sequence[float], leading: tuple[int, ...]) -> list[float]:
    nm = [float(w) for w in np.atleast_1d(real("wavelengths_nm", wavelengths_nm, np.float64))]
    if len(nm) != 1 and (not leading or leading[-1] != len(nm)):
        raise InputError(f"got {len(nm)} wavelengths, but the last axis of shape {leading} has another length; pass one wavelength per entry")
    return nm


@dataclass(frozen=True)
class _Instrument:
    detector_file: str | None
    detector_text: str | None
    noise: float | None
    relative_noise: float | None
    fov_x_deg: float | None
    bin_ps: float | None
    seed: int


def simulate(
    matrices: npt.ArrayLike,
    scheme: Scheme,
    *,
    wavelengths_nm: float | Sequence[float] = 550.0,
    detector: Mapping[str, Any] | str | os.PathLike[str] | None = None,
    noise: float | None = None,
    relative_noise: float | None = None,
    seed: int = 0,
    fov_x_deg: float | None = None,
    bin_ps: float | None = None,
    variance: bool = False,
) -> Any:
    """Simulate the captures of known Mueller matrices by a rig with a scheme, as `sunstone capture`.

    Intensities have the unit of the matrices. Matrices that Sunstone renders are spectral radiance per unit projector drive,
    W/(m² sr nm), and scale with the ``irradiance`` of the projector in the scene file.

    Parameters
    ----------
    matrices
        (..., 4, 4). With a detector or ``fov_x_deg``, the first two axes are rows and columns.
    wavelengths_nm
        Vacuum wavelengths in nanometres: one for all, or one for each entry of the last axis before the matrices.
    detector
        A camera or a photon counter: the path of a detector file or a calibration, or the content of a detector file as a dict,
        ``{"cmos": {"full_well_e": 1e4}}``. For a polarizer array, add ``demosaic``. See the notes for the keys and their units.
    noise, relative_noise
        Standard deviation of Gaussian noise, in the unit of the matrices or relative to the mean M00 (without a unit).
    seed
        Seed of the noise.
    fov_x_deg
        Horizontal field of view of a pinhole camera in degrees, with which light passes plates and mirrors in the direction of each
        pixel. By default, all light passes along the optical axis.
    bin_ps
        Width of the time bins in picoseconds; time is then the third axis. Required for a ``spad``.
    variance
        Also return the variances of a camera's readings, in the squared unit of the matrices (infinite for saturated readings).

    Returns
    -------
    numpy.ndarray, or two of them
        float32, (captures, ...), or (captures, 4, ...) for a polarizer array; with binning or superpixels, half the number of rows
        and columns. Intensities are in the unit of the matrices, also with a detector. Saturated intensities are NaN. Intensities of
        dark pixels can be negative, because the dark signal is subtracted.

    Notes
    -----
    **Camera** (``cmos``; the linear model of EMVA 1288). An intensity L generates on average (η Φ L + d) t electrons, with shot noise
    (Poisson). The electrons above the full well are lost. Read noise is added, and the sum is divided by the gain K, added to the black
    level b, rounded and clipped to 0 ... 2^``bit_depth`` - 1. Each digital number DN becomes an intensity again, L = ((DN - b) K - d t) /
    (η Φ t), with the variance (electrons + ``read_noise_e``² + K²/12) / (η Φ t)².

    - ``exposure_s``: exposure time t in seconds, by default 0.01. `exposure_for` computes it for a scene.
    - ``photons_per_unit``: Φ, photons per second that reach a pixel per unit of intensity, by default 1e6. It includes the power of the
      projector, the lens, the pixel's area and the spectral bandwidth. The default is a placeholder. Φ is equal for all wavelengths.
    - ``quantum_efficiency``: η, electrons per photon, 0 to 1: a number, or rows [nm, value] of a table. By default 0.65.
    - ``full_well_e``: capacity of a pixel in electrons, by default 10 700.
    - ``bit_depth``: bits of the digital numbers, 1 to 24, by default 12.
    - ``gain_e_per_dn``: K in electrons per digital number, by default ``full_well_e`` / (2^``bit_depth`` - 1).
    - ``black_level_dn``: b, the digital number without electrons, by default 16.
    - ``read_noise_e``: standard deviation in electrons, by default 2.4. ``dark_current_e_s``: d in electrons per second, by default 1.
    - ``bracket``: factors of ``exposure_s``. Each capture has one exposure per factor; the unsaturated exposures are averaged with inverse
      variances as weights. By default [1].
    - ``binning``: 1, or 2 for the mean of 2 × 2 pixels after read-out. The mean has a quarter of the variance; the full well does not
      change. If one of the pixels is saturated, the mean is saturated.
    - ``shot_noise``: False removes the shot noise of photons and dark electrons.

    A reading is saturated from the maximum of the digital numbers, or from the reading 4 standard deviations of the read-out noise (read
    noise and quantization) below the full well, whichever is smaller.

    **Photon counter** (``spad``). An intensity L of a time bin causes η Φ L detections per laser pulse, convolved with the instrument's
    response, plus dark counts. Counts become intensities again, corrected for dead time. The settings have other names and units:

    - ``photons_per_unit``: photons at the diode per laser pulse and per unit of intensity, by default 1. There is no exposure time:
      ``pulses`` is the number of laser pulses per capture, by default 10⁶.
    - ``detection_efficiency``: detections per photon, by default 0.3. ``dark_counts_per_s`` is per second, by default 100.
    - ``period_ps``, ``dead_time_ps``, ``irf_fwhm_ps``, ``irf_tail_ps``, ``after_pulse_time_ps``: times in picoseconds.
    """
    found, variances = simulated(
        matrices,
        scheme,
        wavelengths_nm=wavelengths_nm,
        detector=detector,
        noise=noise,
        relative_noise=relative_noise,
        seed=seed,
        fov_x_deg=fov_x_deg,
        bin_ps=bin_ps,
    )
    lost = int(np.isnan(found).sum())
    if lost and bool(np.isfinite(np.asarray(matrices, np.float64)).all()):
        caution([f"{100 * lost / found.size:.3g} % of the intensities are saturated, and NaN in the result; reduce the exposure"])
    if not variance:
        return found
    if variances is None:
        raise InputError("variance: only a camera provides variances; use a `cmos` detector, or pass `noise` to `reconstruct`")
    return found, variances


def simulated(
    matrices: npt.ArrayLike,
    scheme: Scheme,
    *,
    wavelengths_nm: float | Sequence[float] = 550.0,
    detector: Mapping[str, Any] | str | os.PathLike[str] | None = None,
    noise: float | None = None,
    relative_noise: float | None = None,
    seed: int = 0,
    fov_x_deg: float | None = None,
    bin_ps: float | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32] | None]:
    """Return the result of `simulate`, and the variances if they are known."""
    array = real("matrices", matrices, np.float64)
    if array.ndim < 2 or array.shape[-2:] != (4, 4):
        raise InputError(f"the matrices' shape is {array.shape}; give (..., 4, 4)")
    leading = array.shape[:-2]
    nm = _lanes(wavelengths_nm, leading)
    native = scheme._native  # pyright: ignore[reportPrivateUsage]
    if detector is None and relative_noise is None and fov_x_deg is None and bin_ps is None:
        found = _native.simulate(native, array, nm, noise or 0.0, seed)
        return found.reshape(_measured(scheme) + leading), None
    text = json_of(detector) if isinstance(detector, Mapping) else None
    path = None if detector is None or isinstance(detector, Mapping) else os.fspath(detector)
    instrument = _Instrument(path, text, noise, relative_noise, fov_x_deg, bin_ps, seed)
    along = len(nm) > 1 or np.ndim(wavelengths_nm) == 1
    found, variances, pixels = _native.capture(native, array, nm, along, instrument)
    shape = (*_measured(scheme), *pixels)
    return found.reshape(shape), None if variances is None else variances.reshape(shape)


def _second_moment(prior: Any) -> npt.NDArray[np.float64] | None:
    if prior is None:
        return None
    if isinstance(prior, str | os.PathLike):
        return _native.LearningData.load(os.fspath(prior)).prior  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]
    return real("prior", prior, np.float64)


def reconstruct(
    intensities: npt.ArrayLike,
    scheme: Scheme,
    *,
    variance: npt.ArrayLike | None = None,
    wavelengths_nm: float | Sequence[float] = 550.0,
    noise: float | None = None,
    saturation: float | None = None,
    realizable: bool = False,
    errors: bool = False,
    prior: npt.ArrayLike | str | os.PathLike[str] | None = None,
    fov_x_deg: float | None = None,
) -> Any:
    """Reconstruct Mueller matrices from captures, as `sunstone reconstruct`.

    Parameters
    ----------
    intensities
        (captures, ...), or (captures, 4, ...) for a polarizer array, in any unit that is proportional to radiance, without the dark
        signal. The matrices and standard errors have the same unit. NaN and masked entries (``numpy.ma``) are excluded. Contiguous
        arrays of single or double precision are read without a copy.
    variance
        Variances of the intensities, in the squared unit of the intensities, of the same shape. They are used as weights.
    wavelengths_nm
        Vacuum wavelengths in nanometres: one for all intensities, or one for each entry of the last axis.
    noise
        Standard deviation of the intensities in their unit, for errors, if there are no variances.
    saturation
        Intensities at or above this value, in the unit of the intensities, are excluded.
    realizable
        Return the nearest realizable matrices.
    errors
        Also return standard errors. Without ``noise`` and ``variance``, standard errors are estimated from the residuals of the
        fit, which requires more than 16 measurements.
    prior
        Prior for the expected matrices, for schemes with few captures: the second moment of matrices with M00 = 1, (16, 16), such
        as `Materials.prior`, or the path of its file. Requires ``noise``.
    fov_x_deg
        Horizontal field of view in degrees, see `simulate`. The first two axes of the pixels are then rows and columns.

    Returns
    -------
    numpy.ndarray, or two of them
        (..., 4, 4), in the unit and the precision of the intensities; standard errors of the same shape and unit.
    """
    array = real("intensities", intensities, fill=np.nan)
    measured = _measured(scheme)
    if array.shape[: len(measured)] != measured:
        raise InputError(f"the intensities' shape is {array.shape}; {scheme.captures} captures need the shape {measured} + (...)")
    leading = array.shape[len(measured) :]
    nm = _lanes(wavelengths_nm, leading)
    flat = (scheme.captures * scheme.channels, int(np.prod(leading, dtype=np.int64)))
    weights = None
    if variance is not None:
        # Entries without a variance are excluded, like saturated entries of a camera.
        weights = real("variance", variance, array.dtype, fill=np.inf)
        if weights.shape != array.shape:
            raise InputError(f"variance: the shape is {weights.shape}, but that of the intensities is {array.shape}")
        weights = weights.reshape(flat)
    view = None
    if fov_x_deg is not None:
        if len(leading) < 2:
            raise InputError("fov_x_deg: the intensities have no rows and columns after captures and channels; omit fov_x_deg")
        view = (float(fov_x_deg), leading[0], leading[1])
    found, spread = _native.reconstruct(
        scheme._native,  # pyright: ignore[reportPrivateUsage]
        array.reshape(flat),
        weights,
        nm,
        noise,
        saturation,
        realizable,
        errors,
        _second_moment(prior),
        view,
    )
    shape = (*leading, 4, 4)
    return found.reshape(shape) if spread is None else (found.reshape(shape), spread.reshape(shape))
