"""Learning the settings of capture schemes: the angles of least expected error."""

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
from pysunstone._progress import Progress, told
from pysunstone.capture import Scheme

__all__ = ["Descent", "Learned", "Materials", "learn"]

Path = str | os.PathLike[str]


class Materials:
    """What Mueller matrices are expected: their second moment, and for cross-validation those of folds of materials.

    Made by `measured`, `stand_ins`, `of_matrices`, `of_second_moment` or `load`; made once, it serves many schemes.
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
        """The analytic stand-ins for the 25 materials of the KAIST set, evaluated at ``resolution`` entries of φ_d, θ_d and θ_h.

        ``frames``: ``"any"``, turned by any angle, as those of a camera and a projector are to the plane of scattering, or
        ``"plane"``, of that plane. ``folds`` of the cross-validation over materials; 0 for none.
        """
        return cls(_native.LearningData.materials(None, list(bands), frames == "plane", resolution, folds))

    @classmethod
    def measured(
        cls, folder: Path, *, bands: Sequence[int] = (450, 550, 650), frames: Literal["any", "plane"] = "any", folds: int = 5
    ) -> Materials:
        """All ``.pbsdf`` tables of a folder, at the bands nearest to those given, nanometres; see `stand_ins`."""
        return cls(_native.LearningData.materials(folder, list(bands), frames == "plane", (2, 2, 2), folds))

    @classmethod
    def of_matrices(cls, matrices: npt.ArrayLike, *, turned: bool = False) -> Materials:
        """Mueller matrices (..., 4, 4) of one's own, each divided by its M00; NaN and dark ones are left out.

        ``turned``: they are expected between frames that are turned by any angles, independently on both sides.
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
        """E[t tᵀ] of matrices t (16 elements, row-major) with M00 = 1: (16, 16)."""
        return cls(_native.LearningData.of_moment(real("second_moment", second_moment, np.float64), False))

    @classmethod
    def load(cls, path: Path) -> Materials:
        """A prior's file, as `save` and `sunstone learn --save-prior` write it."""
        return cls(_native.LearningData.load(path))

    def save(self, path: Path, name: str = "materials") -> None:
        """Write the second moment's file (TOML), which `sunstone reconstruct --prior` takes."""
        self._native.save(path, name)

    @property
    def prior(self) -> npt.NDArray[np.float64]:
        """The second moment of all, (16, 16), as `pysunstone.reconstruct` takes it."""
        return self._native.prior


@dataclass(frozen=True)
class Descent:
    """Where a search began, and what it found.

    Attributes
    ----------
    name
        ``Adam from the template``, ``quasi-Newton, start 3``.
    loss
        The least loss that it met.
    history
        The loss at every evaluation, infinite where a scheme has none.
    """

    name: str
    loss: float
    history: npt.NDArray[np.float64] = field(repr=False)


@dataclass(frozen=True)
class Learned:
    """A learned scheme, and what it is worth.

    Losses are expected sums of the squared errors of the 16 elements of matrices with M00 = 1.

    Attributes
    ----------
    scheme
        The scheme, learned from all materials.
    loss
        Its loss on materials that were not learned from, mean of the folds; without folds, or where it does not depend on
        materials (least squares of rank 16), that of the closed form.
    loss_std_error
        Standard error of ``loss`` over the folds; 0 without them.
    seen_loss
        The loss on the materials that were learned from.
    descents
        All searches, the template's first.
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
    """Learn a scheme's settings: the angles of least expected error, as `sunstone learn`.

    Minimizes the expected squared error of the 16 elements over noise and, where captures are fewer than 16 or a prior is used, over
    materials: in closed form, with its exact gradient, by Adam from the template's angles (Baek & Heide 2021, sec. 4) and by a
    quasi-Newton method from many random starts. The same seed gives the same scheme, whatever the number of threads. Python goes on
    beside it; Ctrl-C ends it.

    Parameters
    ----------
    captures
        Captures of four perfect rotating elements, 1 to 256; or a ``template``.
    polarizer_array
        Read by a sensor with polarizers on its pixels.
    template
        Learn the settings of this scheme, with its optics, instead.
    estimator
        How matrices will be estimated: ``"least-squares"``, or ``"prior"`` (least expected error, given the second moment).
    noise
        Standard deviation of an intensity's noise, where M00 = 1.
    angle_error_deg
        Standard deviation of the stages' angles (and of retardances) that the scheme shall bear.
    wavelengths_nm
        Where it shall work.
    materials
        What is expected, where it matters: `Materials`; matrices (..., 4, 4); a second moment (16, 16); a folder of ``.pbsdf``
        tables; a prior's file; None for the stand-ins (made anew: some seconds).
    starts, iterations, adam_steps
        The budget: random starts, most iterations from each, steps of Adam.
    seed
        Of the random starts.
    progress
        True for a bar, or a function that is called with descents done and descents in all.

    Returns
    -------
    Learned

    Raises
    ------
    InputError
        Numbers out of range, a template in which nothing changes.
    """
    if (captures is None) == (template is None):
        raise InputError("give captures, or a template")
    if estimator not in ("least-squares", "prior"):
        raise InputError(f"estimator: there is no `{estimator}`; choose of least-squares, prior")
    if not 0 <= angle_error_deg <= 90:
        raise InputError("angle_error_deg: give degrees, 0 to 90")
    if template is None:
        if captures is None or not 1 <= captures <= 256:
            raise InputError(f"captures is {captures}; learn 1 to 256")
        template = Scheme(_native.Scheme.preset("quad", captures, polarizer_array))
    elif polarizer_array:
        raise InputError("polarizer_array: the template has its sensor; leave this out")
    # The noise of a full-rank least-squares estimate does not depend on what is measured.
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
    with told(progress, "descent") as tell:
        scheme, (unseen, spread, seen), descents = _native.learn(
            template._native,  # pyright: ignore[reportPrivateUsage]
            data,
            asked,
            tell,
        )
    return Learned(Scheme(scheme), unseen, spread, seen, [Descent(*d) for d in descents])
