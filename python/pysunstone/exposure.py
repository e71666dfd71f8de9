"""Exposure time of a camera for a scene, and the electrons, noise and saturation that result."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

from pysunstone._arrays import plain, real
from pysunstone._documents import json_of
from pysunstone._native import InputError
from pysunstone.capture import Scheme, simulate
from pysunstone.scene import Scene, Slice

__all__ = ["Exposure", "exposure_for"]

Kind = Literal["mueller", "stokes", "intensities"]
Detector = Mapping[str, Any] | str | os.PathLike[str]

#: Wavelength of data without wavelengths, as in `simulate`.
_DEFAULT_NM = 550.0
#: Axes of a slice whose entries a camera adds during one exposure.
_ADDED = ("v", "u", "t", "bounces", "component", "label")
#: A reading is saturated at this number of standard deviations of the read-out noise below the full well (`CERTAIN` in cmos.rs).
_CERTAIN = 4.0
#: Number of values that are processed at a time.
_CHUNK = 1 << 20


@dataclass(frozen=True, repr=False)
class Exposure:
    """Exposure time of a camera for a scene, with the photon budget at this exposure time. `exposure_for` returns it.

    Attributes
    ----------
    exposure_s
        Exposure time in seconds. With a ``bracket``, the exposure time that the factors multiply.
    share
        Share of the usable range that the electrons of the requested quantile fill, 0 to 1. With a ``bracket``, in the shortest
        exposure.
    usable_e
        Usable range of the camera in electrons: the electrons in one pixel at which a reading without noise becomes saturated.
    electrons
        Mean number of photoelectrons of the median lit intensity in one sensor pixel, without dark electrons. With a ``bracket``,
        in the shortest exposure. An intensity is lit if it generates photoelectrons.
    snr
        Signal-to-noise ratio of the median lit intensity as `simulate` returns it: with shot noise, read noise, quantization, all
        unsaturated exposures of the ``bracket``, and ``binning``. Demosaicking is not included.
    saturated
        Expected share of saturated intensities, 0 to 1, before binning and demosaicking. With a ``bracket``, an intensity is
        saturated if it is saturated in all exposures. Shot noise is approximated as normal noise.
    detector
        The detector with this exposure time, for ``simulate(detector=...)``.
    """

    exposure_s: float
    share: float
    usable_e: float
    electrons: float
    snr: float
    saturated: float
    detector: dict[str, Any] = field(hash=False)

    def __repr__(self) -> str:
        return (
            f"<pysunstone.Exposure {self.exposure_s:.4g} s, median {self.electrons:.4g} electrons, SNR {self.snr:.3g}, "
            f"saturated {100 * self.saturated:.2g} %>"
        )


@dataclass(frozen=True)
class _Camera:
    """The settings of a camera. Defaults and formulas are those of `src/polarimetry/capture/detector/cmos.rs`."""

    bracket: Sequence[float] = (1.0,)
    quantum_efficiency: float | Sequence[Sequence[float]] = 0.65
    photons_per_unit: float = 1e6
    read_noise_e: float = 2.4
    dark_current_e_s: float = 1.0
    full_well_e: float = 10_700.0
    bit_depth: int = 12
    gain_e_per_dn: float | None = None
    black_level_dn: float = 16.0
    binning: int = 1
    shot_noise: bool = True

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> _Camera:
        return cls(**{name: value for name, value in settings.items() if name != "exposure_s"})

    @property
    def top_dn(self) -> float:
        """Largest digital number."""
        return 2.0**self.bit_depth - 1

    @property
    def gain(self) -> float:
        """Electrons per digital number."""
        return self.full_well_e / self.top_dn if self.gain_e_per_dn is None else self.gain_e_per_dn

    @property
    def read_out(self) -> float:
        """Variance of read noise and quantization, in electrons squared."""
        return self.read_noise_e**2 + self.gain**2 / 12

    @property
    def saturation_dn(self) -> int:
        """Smallest digital number of a saturated reading."""
        full = (self.full_well_e - _CERTAIN * math.sqrt(self.read_out)) / self.gain + self.black_level_dn
        return max(int(min(full, self.top_dn)), 0)

    @property
    def usable_e(self) -> float:
        """Electrons at which a reading without noise becomes saturated. Half a digital number is due to rounding."""
        return (self.saturation_dn - 0.5 - self.black_level_dn) * self.gain

    def efficiency(self, nm: float) -> float:
        """Return the quantum efficiency at a wavelength."""
        if isinstance(self.quantum_efficiency, int | float):
            return float(self.quantum_efficiency)
        rows = np.array(self.quantum_efficiency, np.float64)
        return float(np.interp(nm, rows[:, 0], rows[:, 1]))

    def shot(self, mean: Any) -> Any:
        """Return the shot-noise variance of a mean number of electrons."""
        return mean if self.shot_noise else 0.0 * mean

    def snr(self, rate: float, exposure_s: float) -> float:
        """Return the signal-to-noise ratio of a reading with a number of photoelectrons per second."""
        weights = 0.0
        times = [exposure_s * factor for factor in self.bracket]
        # The shortest exposure is the last to saturate. If it is saturated too, its electrons still have a noise.
        kept = [t for t in times if (rate + self.dark_current_e_s) * t < self.usable_e] or [min(times)]
        for t in kept:
            variance = float(self.shot((rate + self.dark_current_e_s) * t)) + self.read_out
            weights += t**2 / variance
        return rate * math.sqrt(weights) * self.binning

    def saturated(self, rates: npt.NDArray[Any], exposure_s: float) -> float:
        """Return the expected share of values that are saturated in all exposures."""
        z = np.linspace(-7.0, 7.0, 8193)
        beyond = np.array([0.5 * math.erfc(v / math.sqrt(2)) for v in z])
        beyond[0], beyond[-1] = 1.0, 0.0
        total = 0.0
        for start in range(0, rates.size, _CHUNK):
            chunk = rates[start : start + _CHUNK].astype(np.float64)
            odds: list[npt.NDArray[np.float64]] = []
            for factor in self.bracket:
                mean = (chunk + self.dark_current_e_s) * (exposure_s * factor)
                # The digital number, not the noise of the quantization, decides on saturation.
                spread: Any = np.sqrt(self.shot(mean) + self.read_noise_e**2)
                below: npt.NDArray[np.float64] = (self.usable_e - mean) / np.maximum(spread, 1e-9)
                odds.append(np.interp(below, z, beyond))
            total += float(np.prod(odds, axis=0).sum())
        return total / rates.size


def _toml(text: str) -> dict[str, Any] | None:
    """Parse TOML; None if this version of Python cannot."""
    if sys.version_info >= (3, 11):
        import tomllib

        return tomllib.loads(text)
    return None


def _check(detector: Detector) -> None:
    """Check all settings of a camera as `simulate` does."""
    simulate(np.zeros((2, 2, 4, 4)), Scheme.drr(16), detector=detector)


def _document(detector: Detector) -> dict[str, Any]:
    """Return the content of a detector file or of a calibration."""
    if isinstance(detector, Mapping):
        return cast("dict[str, Any]", json.loads(json_of(detector)))
    try:
        found = _toml(Path(detector).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        _check(detector)
        raise
    if found is None:
        raise InputError(f"detector: {os.fspath(detector)} requires Python 3.11 or later; pass the content of the file as a dict")
    return found


def _camera(detector: Detector) -> tuple[dict[str, Any], _Camera]:
    """Return the keys of the detector that `simulate` needs, and the camera."""
    document = _document(detector)
    calibrated: Any = document.get("detector")
    tables: dict[str, Any] = document
    if isinstance(calibrated, dict) and not {"cmos", "spad"} & document.keys():
        tables = cast("dict[str, Any]", calibrated)
    if "spad" in tables and "cmos" not in tables:
        raise InputError(
            "detector: found a photon counter (`spad`), which has no exposure time; expected a camera (`cmos`); for a photon counter, "
            "choose `pulses` = counts / (detection_efficiency * photons_per_unit * intensity of a time bin)"
        )
    _check(detector)
    kept: dict[str, Any] = {"cmos": dict(tables["cmos"])}
    if "demosaic" in document:
        kept["demosaic"] = document["demosaic"]
    return kept, _Camera.of(kept["cmos"])


def _slice_name(scene: Scene, polarized: bool) -> str:
    """Return the name of a slice with every camera pixel and all light, and with polarization if the scene has such a slice."""
    document = _toml(scene.text)
    if document is None:
        raise InputError(f"slice: with Python 3.10, pass the name of a slice of the scene: {', '.join(scene.slices)}")
    entries: list[dict[str, Any]] = document.get("slices", [])
    complete = [e for e in entries if e.get("camera", "all") == "all" and e.get("projector", "sum") == "sum"]
    mueller = [e for e in complete if e.get("polarization") == "mueller"]
    found = mueller if polarized else mueller or complete
    if not found:
        need = 'and `polarization = "mueller"`, which the scheme requires' if polarized else "of all projector pixels"
        raise InputError(
            f"scene {scene.name!r}: expected a slice with every camera pixel, the sum over projector pixels "
            f"{need}; found the slices {', '.join(scene.slices) or '(none)'}; add to the scene file: "
            '[[slices]] name = "photo" polarization = "mueller"'
        )
    small = min(found, key=lambda e: sum(key in e for key in ("time", "bounces", "split_first_bounce", "labels")))
    return str(small["name"])


@dataclass(frozen=True)
class _Named:
    """Values with named axes."""

    dims: tuple[str, ...]
    values: npt.NDArray[Any]
    wavelengths_nm: list[float] | None


def _summed(dims: Sequence[str], values: Any) -> tuple[tuple[str, ...], npt.NDArray[Any]]:
    over = tuple(i for i, dim in enumerate(dims) if dim in _ADDED)
    return tuple(d for d in dims if d not in _ADDED), np.asarray(values).sum(axis=over, dtype=np.float64)


def _of_slice(given: Slice) -> _Named:
    dims, values = _summed(given.dims, given.arrays["mean"])
    if "overflow" in given.arrays:
        values = values + _summed(given.array_dims["overflow"], given.arrays["overflow"])[1]
    nm = given.coords.get("wavelength")
    return _Named(dims, values, None if nm is None else [float(w) for w in nm])


def _of_xarray(given: Any) -> _Named:
    outside: Any = None
    if hasattr(given, "data_vars"):
        if "mean" not in given:
            raise InputError("scene_or_matrices: found an xarray data set without the array `mean`; pass a slice of a store")
        given, outside = given["mean"], given["overflow"] if "overflow" in given else None
    dims, values = _summed([str(d) for d in given.dims], given.values)
    if outside is not None:
        values = values + _summed([str(d) for d in outside.dims], outside.values)[1]
    nm = [float(w) for w in np.atleast_1d(given["wavelength"].values)] if "wavelength" in given.coords else None
    return _Named(dims, values, nm)


def _numbers(wavelengths_nm: float | Sequence[float]) -> list[float]:
    return [float(w) for w in np.atleast_1d(real("wavelengths_nm", wavelengths_nm, np.float64))]


def _chosen(found: _Named, wavelengths_nm: float | Sequence[float] | None) -> _Named:
    """Return the entries of the wavelengths that the caller selects."""
    if wavelengths_nm is None:
        return found
    wanted = _numbers(wavelengths_nm)
    known = found.wavelengths_nm
    if known is None:
        return _Named(found.dims, found.values, wanted)
    missing = [w for w in wanted if w not in known]
    if missing:
        raise InputError(f"wavelengths_nm: found {missing[0]:g}, which is not a wavelength of the data; choose from {known}")
    if "wavelength" not in found.dims:
        return found
    at = [known.index(w) for w in wanted]
    return _Named(found.dims, found.values.take(at, found.dims.index("wavelength")), wanted)


def _ordered(found: _Named) -> tuple[npt.NDArray[Any], Kind]:
    """Return the array with captures first, the wavelength after all other axes, and the Stokes elements last."""
    first, last = ("capture", "channel", "y", "x"), ("wavelength", "stokes_out", "stokes_in")
    order = [d for d in first if d in found.dims]
    order += [d for d in found.dims if d not in (*first, *last)] + [d for d in last if d in found.dims]
    values = found.values.transpose([found.dims.index(d) for d in order])
    if "stokes_in" in order:
        return values, "mueller"
    return values, "stokes" if "stokes_out" in order else "intensities"


def _values(
    given: Any, scheme: Scheme | None, wavelengths_nm: float | Sequence[float] | None, kind: Kind | None, name: str | None, spp: int
) -> tuple[npt.NDArray[Any], Kind, list[float]]:
    """Return the values, what they are, and their wavelengths."""
    if kind not in (None, "mueller", "stokes", "intensities"):
        raise InputError(f"kind: expected 'mueller', 'stokes' or 'intensities', got {kind!r}")
    if isinstance(given, Scene):
        name = name or _slice_name(given, scheme is not None)
        nm = given.wavelengths_nm
        found = _of_slice(given.render(spp=spp, slices=name)[name])
        found = _Named(found.dims, found.values, found.wavelengths_nm or nm)
    elif isinstance(given, Slice):
        found = _of_slice(given)
    elif hasattr(given, "dims") and hasattr(given, "coords"):
        found = _of_xarray(given)
    elif isinstance(given, Mapping):
        names = ", ".join(str(key) for key in cast(Any, given))
        raise InputError(f"scene_or_matrices: found several slices ({names}); pass one of them")
    else:
        array = plain("scene_or_matrices", given)
        if array.dtype.kind not in "fiub":
            raise InputError(
                f"scene_or_matrices: found {type(given).__name__}; expected a Scene, a Slice, an xarray slice, or an array of real numbers"
            )
        if kind is None:
            kind = "mueller" if array.shape[-2:] == (4, 4) else "intensities"
        elements = {"mueller": (4, 4), "stokes": (4,), "intensities": ()}[kind]
        if array.shape[array.ndim - len(elements) :] != elements:
            raise InputError(f"scene_or_matrices: found the shape {array.shape}; kind {kind!r} requires (..., {str(elements)[1:]}")
        nm = _numbers(_DEFAULT_NM if wavelengths_nm is None else wavelengths_nm)
        return array, kind, nm
    found = _chosen(found, wavelengths_nm)
    values, kind = _ordered(found)
    return values, kind, found.wavelengths_nm or [_DEFAULT_NM]


def _intensities(
    values: npt.NDArray[Any], kind: Kind, nm: list[float], scheme: Scheme | None
) -> npt.NDArray[Any]:
    """Return the intensities at the camera, with the wavelength as the last axis if there are several wavelengths."""
    if scheme is not None and kind == "mueller":
        return cast("npt.NDArray[Any]", simulate(values, scheme, wavelengths_nm=nm if len(nm) > 1 else nm[0]))
    if scheme is not None:
        raise InputError(
            f"scheme: found {kind} without Mueller matrices; a scheme requires matrices of shape (..., 4, 4), or a slice with "
            '`polarization = "mueller"`; omit the scheme if the intensities are those of its captures'
        )
    if kind == "mueller":
        return values[..., 0, 0]
    return values[..., 0] if kind == "stokes" else values


def _within(name: str, value: Any) -> float:
    number = float(value) if isinstance(value, int | float | np.floating) else math.nan  # pyright: ignore[reportUnknownArgumentType]
    if not 0 < number <= 1:
        raise InputError(f"{name}: expected a number above 0 and at most 1, got {value!r}")
    return number


def exposure_for(
    scene_or_matrices: Any,
    detector: Detector,
    share: float = 0.8,
    *,
    scheme: Scheme | None = None,
    quantile: float = 0.999,
    wavelengths_nm: float | Sequence[float] | None = None,
    kind: Kind | None = None,
    slice: str | None = None,
    spp: int = 16,
) -> Exposure:
    """Return the exposure time with which the brightest intensities of a scene fill a share of a camera's range.

    With the exposure time t, an intensity L generates on average (η Φ L + d) t electrons in a pixel: η is the quantum efficiency at
    the wavelength, Φ is ``photons_per_unit`` in photons per second, and d is the dark current. The function solves (η Φ L + d) t =
    ``share`` × usable range, where η L is the ``quantile`` over pixels, wavelengths and, with a scheme, captures and channels.

    The usable range is (s - ½ - ``black_level_dn``) × gain in electrons. The digital number s is the smallest one that `simulate`
    treats as saturated: the maximum of ``bit_depth`` bits, or the reading 4 standard deviations of the read-out noise below the
    full well, whichever is smaller. ``binning`` averages pixels after read-out and does not change the range. With a ``bracket``,
    the quantile fills the share in the shortest exposure, because `simulate` excludes saturated exposures.

    Parameters
    ----------
    scene_or_matrices
        Light at the camera, in the unit of the scene's radiance, W/(m² sr nm) per unit projector drive:

        - a `Scene`, of which one slice is rendered in memory. By default, the slice has every camera pixel, the sum over projector
          pixels and, if possible, Mueller matrices.
        - a `Slice` or an xarray slice. Time bins, bounces, components, labels and projector pixels are summed.
        - an array of Mueller matrices (..., 4, 4), or of intensities. The last axis before the matrices is the wavelength if there
          are several ``wavelengths_nm``.

        Without a scheme, the intensity of a Mueller matrix is M00: unpolarized light, and no analyzer.
    detector
        A camera: the path of a detector file or of a calibration, or the content of a detector file as a dict, as for `simulate`.
        The exposure time of the detector is ignored.
    share
        Share of the usable range, above 0 and at most 1.
    scheme
        Capture scheme. The intensities are then those of all captures and channels.
    quantile
        Quantile of the intensities that fills the share, above 0 and at most 1. Noise of the render raises the largest intensities:
        for quantiles near 1, increase ``spp``.
    wavelengths_nm
        For arrays: one wavelength for all, or one for each entry of the last axis; by default 550. For scenes and slices: the
        wavelengths to use; by default all of them.
    kind
        Meaning of an array: ``"mueller"`` (..., 4, 4), ``"stokes"`` (..., 4) or ``"intensities"``. By default, arrays of shape
        (..., 4, 4) are Mueller matrices, and all other arrays are intensities.
    slice
        Name of the slice to render, for a `Scene`.
    spp
        Samples per pixel, for a `Scene`.

    Returns
    -------
    Exposure
        The exposure time in seconds, the electrons, SNR and saturation that result, and the detector with this exposure time.

    Raises
    ------
    InputError
        If the scene is black, has no suitable slice, or the detector is not a camera.

    Examples
    --------
    >>> import numpy as np
    >>> white = np.zeros((2, 2, 4, 4))
    >>> white[..., 0, 0] = 1.0
    >>> camera = {"cmos": {"photons_per_unit": 1e5, "quantum_efficiency": 0.5, "dark_current_e_s": 0.0}}
    >>> exposure_for(white, camera)
    <pysunstone.Exposure 0.1705 s, median 8526 electrons, SNR 92.3, saturated 0 %>
    """
    share, quantile = _within("share", share), _within("quantile", quantile)
    document, camera = _camera(detector)
    if not camera.usable_e > 0:
        raise InputError(
            f"detector: found a usable range of {camera.usable_e:g} electrons (saturation at {camera.saturation_dn} DN, black level "
            f"{camera.black_level_dn:g} DN); expected a positive range; decrease `black_level_dn`, or increase `bit_depth` "
            "or `full_well_e`"
        )
    values, kind, nm = _values(scene_or_matrices, scheme, wavelengths_nm, kind, slice, spp)
    light = _intensities(values, kind, nm, scheme)
    if len(nm) > 1 and light.shape[-1:] != (len(nm),):
        raise InputError(f"wavelengths_nm: found {len(nm)} wavelengths for the shape {light.shape}; pass one per entry of the last axis")
    # Photoelectrons per second. The model treats negative intensities as dark.
    rates = np.maximum(light, 0) * (np.array([camera.efficiency(w) for w in nm]) * camera.photons_per_unit)
    rates = rates.ravel()
    if not np.isfinite(rates).all():
        raise InputError(f"scene_or_matrices: {int((~np.isfinite(rates)).sum())} intensities are not finite; remove or replace them")
    lit = rates[rates > 0]
    if not lit.size:
        raise InputError(
            "scene_or_matrices: found no light (all intensities are 0 or negative, or the quantum efficiency is 0); expected at least one "
            "positive intensity; check emitters, wavelengths and `quantum_efficiency`"
        )
    level = float(np.quantile(rates, quantile))
    if not level > 0:
        raise InputError(
            f"quantile: the quantile {quantile:g} of the intensities is 0, because only {lit.size} of {rates.size} are positive; "
            f"expected a quantile above {1 - lit.size / rates.size:.6g}; increase `quantile`"
        )
    shortest = share * camera.usable_e / (level + camera.dark_current_e_s)
    exposure_s = shortest / min(camera.bracket)
    document["cmos"]["exposure_s"] = exposure_s
    median = float(np.median(lit))
    return Exposure(
        exposure_s=exposure_s,
        share=share,
        usable_e=camera.usable_e,
        electrons=median * shortest,
        snr=camera.snr(median, exposure_s),
        saturated=camera.saturated(rates, exposure_s),
        detector=document,
    )
