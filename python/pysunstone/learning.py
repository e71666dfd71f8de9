"""Learns capture schemes: settings that minimize the expected reconstruction error."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pysunstone import _native
from pysunstone._arrays import real
from pysunstone._native import InputError
from pysunstone._progress import Progress, reporting
from pysunstone.capture import Scheme

__all__ = ["Descent", "Learned", "Materials", "learn"]

Path = str | os.PathLike[str]


class Materials:
    """Distribution of the expected Mueller matrices: the second moment over all materials, and the second moments of the folds
    for cross-validation.

    Create an object with `measured`, `stand_ins`, `of_matrices`, `of_second_moment` or `load`, and reuse it for several schemes.
    """

    def __init__(self, native: _native.LearningData) -> None:
        self._native = native

    @classmethod
    def stand_ins(
        cls,
        *,
        bands: Sequence[int] = (450, 550, 650),
        frames: Literal["any", "plane"] = "any",
        resolution: tuple[int, int, int] = (41, 31, 91),
        folds: int = 5,
    ) -> Materials:
        """Return analytic substitutes for the 25 materials of the KAIST data set, evaluated at ``resolution`` entries of φ_d, θ_d
        and θ_h.

        ``frames``: with ``"any"``, the moment is averaged over all rotations of the frames, because camera and projector frames
        may have any orientation to the scattering plane. With ``"plane"``, frames are those of the scattering plane. ``folds`` is
        the number of folds of the cross-validation over materials; 0 for none.
        """
        return cls(_native.LearningData.materials(None, list(bands), frames == "plane", resolution, folds))

    @classmethod
    def measured(
        cls, folder: Path, *, bands: Sequence[int] = (450, 550, 650), frames: Literal["any", "plane"] = "any", folds: int = 5
    ) -> Materials:
        """Load all ``.pbsdf`` tables of a folder, at the bands nearest to those given (nanometres); see `stand_ins`."""
        return cls(_native.LearningData.materials(folder, list(bands), frames == "plane", (2, 2, 2), folds))

    @classmethod
    def of_matrices(cls, matrices: npt.ArrayLike, *, turned: bool = False) -> Materials:
        """Use your own Mueller matrices (..., 4, 4), each divided by its M00. NaN and dark matrices are excluded.

        ``turned``: assume that the frames on both sides are rotated by independent, uniformly distributed angles.
        """
        m = real("matrices", matrices, np.float64)
        if m.ndim < 2 or m.shape[-2:] != (4, 4):
            raise InputError(f"the matrices' shape is {m.shape}; give (..., 4, 4)")
        t = m.reshape(-1, 16)
        t = t[np.isfinite(t).all(-1) & (t[:, 0] > 0)]
        if not len(t):
            raise InputError("matrices: none of them is finite with M00 above 0")
        t = t / t[:, :1]
        return cls(_native.LearningData.of_moment(t.T @ t / len(t), turned))

    @classmethod
    def of_second_moment(cls, second_moment: npt.ArrayLike) -> Materials:
        """Use the second moment E[t tᵀ], (16, 16), of matrices t (16 elements, row-major) with M00 = 1."""
        return cls(_native.LearningData.of_moment(real("second_moment", second_moment, np.float64), False))

    @classmethod
    def load(cls, path: Path) -> Materials:
        """Load a prior from a file of `save` or `sunstone learn --save-prior`."""
        return cls(_native.LearningData.load(path))

    def save(self, path: Path, name: str = "materials") -> None:
        """Write the second moment to a file (TOML) for `sunstone reconstruct --prior`."""
        self._native.save(path, name)

    def __repr__(self) -> str:
        elements = ", ".join(f"{v:.2g}" for v in np.diag(self.prior)[[0, 5, 10, 15]])
        return f"<pysunstone.Materials, second moments of M00, M11, M22, M33: {elements}>"

    @property
    def prior(self) -> npt.NDArray[np.float64]:
        """The second moment over all materials, (16, 16), as `pysunstone.reconstruct` accepts it."""
        return self._native.prior


@dataclass(frozen=True)
class Descent:
    """One descent of an optimizer in the search for a scheme.

    Attributes
    ----------
    name
        Method and start: ``Adam from the template``, ``quasi-Newton, start 3``.
    loss
        The lowest loss found.
    history
        The loss at every evaluation; infinite for schemes without a finite loss.
    """

    name: str
    loss: float
    history: npt.NDArray[np.float64] = field(repr=False)


@dataclass(frozen=True)
class Learned:
    """A learned scheme with its losses.

    A loss is the expected sum of the squared errors of the 16 elements of matrices with M00 = 1.

    Attributes
    ----------
    scheme
        The scheme, learned from all materials.
    loss
        Loss of the scheme on materials that are not used for learning: the mean over the folds. Without folds, or if the loss
        does not depend on materials (least squares of rank 16), the closed-form loss.
    loss_std_error
        Standard error of ``loss`` over the folds; 0 without folds.
    seen_loss
        The loss on the materials used for learning.
    descents
        All searches; the first starts from the template.
    """

    scheme: Scheme
    loss: float
    loss_std_error: float
    seen_loss: float
    descents: list[Descent] = field(repr=False)

    @property
    def rms(self) -> float:
        """Root mean square error of an element, √(loss/16)."""
        return float(np.sqrt(self.loss / 16))


@dataclass(frozen=True)
class _Asked:
    prior: bool
    noise: float
    angle_error_deg: float
    wavelengths_nm: list[float]
    starts: int
    iterations: int
    adam_steps: int
    seed: int


def _materials(given: Any) -> Materials:
    if given is None:
        return Materials.stand_ins()
    if isinstance(given, Materials):
        return given
    if isinstance(given, str | os.PathLike):
        path: str = os.fspath(given)  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType, reportAssignmentType]
        return Materials.measured(path) if os.path.isdir(path) else Materials.load(path)
    array = real("materials", given, np.float64)
    return Materials.of_second_moment(array) if array.shape == (16, 16) else Materials.of_matrices(array)


def learn(
    captures: int | None = None,
    *,
    polarizer_array: bool = False,
    template: Scheme | None = None,
    estimator: Literal["least-squares", "prior"] = "least-squares",
    noise: float = 5e-4,
    angle_error_deg: float = 0.0,
    wavelengths_nm: float | Sequence[float] = 550.0,
    materials: Materials | npt.ArrayLike | Path | None = None,
    starts: int = 24,
    iterations: int = 400,
    adam_steps: int = 2000,
    seed: int = 0,
    progress: bool | Progress | None = None,
) -> Learned:
    """Learn the settings of a scheme that minimize the expected error, as `sunstone learn`.

    The loss is the expected sum of the squared errors of the 16 elements over noise. With fewer than 16 captures or with a prior,
    the expectation is also over materials. The loss has a closed form with an exact gradient. Adam searches from the template's
    angles (Baek & Heide 2021, sec. 4), and a quasi-Newton method from many random starts. The same seed gives the same scheme for
    any number of threads. Other Python threads keep running during the search. Ctrl-C stops the search.

    Parameters
    ----------
    captures
        Number of captures of four ideal rotating elements, 1 to 256. Pass either this or a ``template``.
    polarizer_array
        Whether the sensor has a polarizer array.
    template
        Learn the settings of this scheme; the optics of the scheme do not change.
    estimator
        Estimator of the matrices: ``"least-squares"``, or ``"prior"`` (minimum expected error, given the second moment).
    noise
        Standard deviation of the noise of an intensity, for light with M00 = 1.
    angle_error_deg
        Standard deviation of the errors of stage angles and retardances, degrees, for which the scheme is optimized.
    wavelengths_nm
        Wavelengths, nanometres, over which the loss is averaged.
    materials
        Expected materials, if they affect the loss: `Materials`; matrices (..., 4, 4); a second moment (16, 16); a folder of
        ``.pbsdf`` tables; a prior's file; or None for the substitutes (computed in each call, which takes some seconds).
    starts, iterations, adam_steps
        Number of random starts, maximum number of iterations per start, and number of Adam steps.
    seed
        Seed of the random starts.
    progress
        True for a bar, or a function that is called with the finished and total number of descents.

    Returns
    -------
    Learned

    Raises
    ------
    InputError
        If numbers are out of range, or no setting of the template can change.
    """
    if (captures is None) == (template is None):
        raise InputError("pass either captures, or a template")
    if estimator not in ("least-squares", "prior"):
        raise InputError(f"estimator: unknown estimator `{estimator}`; choose from least-squares, prior")
    if not 0 <= angle_error_deg <= 90:
        raise InputError("angle_error_deg: pass degrees, 0 to 90")
    if template is None:
        if captures is None or not 1 <= captures <= 256:
            raise InputError(f"captures is {captures}; learn 1 to 256")
        template = Scheme(_native.Scheme.preset("quad", captures, polarizer_array))
    elif polarizer_array:
        raise InputError("polarizer_array: the template already defines its sensor; omit this argument")
    # The error of a full-rank least-squares estimate does not depend on the measured matrices.
    few = template.captures < template._native.least_captures  # pyright: ignore[reportPrivateUsage]
    matters = materials is not None or estimator == "prior" or angle_error_deg > 0 or few
    asked = _Asked(
        estimator == "prior",
        noise,
        angle_error_deg,
        [float(w) for w in np.atleast_1d(real("wavelengths_nm", wavelengths_nm, np.float64))],
        starts,
        iterations,
        adam_steps,
        seed,
    )
    data = _materials(materials)._native if matters else None  # pyright: ignore[reportPrivateUsage]
    with reporting(progress, "descent") as tell:
        scheme, (unseen, spread, seen), descents = _native.learn(
            template._native,  # pyright: ignore[reportPrivateUsage]
            data,
            asked,
            tell,
        )
    return Learned(Scheme(scheme), unseen, spread, seen, [Descent(*d) for d in descents])
