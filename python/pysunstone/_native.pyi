"""The extension module; the package around it says what everything means."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, final

import numpy as np
import numpy.typing as npt

__version__: str

class InputError(ValueError):
    file: str | None
    line: int | None
    column: int | None
    message: str | None
    mend: str | None

class RenderError(RuntimeError): ...

_Mesh = tuple[
    npt.NDArray[np.float32],
    npt.NDArray[np.uint32],
    npt.NDArray[np.float32] | None,
    npt.NDArray[np.float32] | None,
]
_Real = npt.NDArray[np.float32] | npt.NDArray[np.float64]

@final
class Scene:
    @staticmethod
    def load(path: str | PathLike[str], variant: int | None) -> Scene: ...
    @staticmethod
    def from_toml(text: str, path: str | PathLike[str], variant: int | None) -> Scene: ...
    @staticmethod
    def from_json(
        json: str,
        folder: str | PathLike[str],
        meshes: Sequence[tuple[str, _Mesh]],
        files: Sequence[tuple[str, bytes]],
    ) -> Scene: ...
    @property
    def name(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def sha256(self) -> str: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def slices(self) -> list[str]: ...
    @property
    def wavelengths_nm(self) -> list[float]: ...
    @property
    def resolution(self) -> tuple[int, int]: ...
    @property
    def spp(self) -> int: ...
    @property
    def seed(self) -> int: ...

@final
class Scheme:
    @staticmethod
    def load(path: str | PathLike[str]) -> Scheme: ...
    @staticmethod
    def from_toml(text: str) -> Scheme: ...
    @staticmethod
    def preset(name: str, captures: int, polarizer_array: bool) -> Scheme: ...
    def to_toml(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def captures(self) -> int: ...
    @property
    def channels(self) -> int: ...
    @property
    def bound(self) -> float: ...
    def quality(self, wavelength_nm: float) -> tuple[int, float, float]: ...
    def design_matrix(
        self, wavelength_nm: float, incidence_deg: float, azimuth_deg: float
    ) -> npt.NDArray[np.float64]: ...

def command(words: Sequence[str]) -> int: ...
def render_store(
    scene: Scene,
    asked: Any,
    output: str | PathLike[str],
    resume: bool,
    force: bool,
    progress: Callable[[int, int], object] | None,
) -> str: ...
def render_arrays(scene: Scene, asked: Any, progress: Callable[[int, int], object] | None) -> dict[str, Any]: ...
def encode_image(values: npt.NDArray[np.uint8] | npt.NDArray[np.float32]) -> bytes: ...
def quantities() -> list[str]: ...
def decompose(matrices: _Real, std_error: _Real | None, only: Sequence[str]) -> tuple[dict[str, npt.NDArray[Any]], int]: ...
def simulate(
    scheme: Scheme,
    matrices: npt.NDArray[np.float64],
    wavelengths_nm: Sequence[float],
    noise: float,
    seed: int,
) -> npt.NDArray[np.float32]: ...
def reconstruct(
    scheme: Scheme,
    intensities: _Real,
    variances: _Real | None,
    wavelengths_nm: Sequence[float],
    noise: float | None,
    saturation: float | None,
    realizable: bool,
    with_errors: bool,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any] | None]: ...
