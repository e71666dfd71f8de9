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
    def least_captures(self) -> int: ...
    @property
    def bound(self) -> float: ...
    def quality(self, wavelength_nm: float) -> tuple[int, float, float]: ...
    def design_matrix(
        self, wavelength_nm: float, incidence_deg: float, azimuth_deg: float
    ) -> npt.NDArray[np.float64]: ...

@final
class LearningData:
    @staticmethod
    def materials(
        folder: str | PathLike[str] | None,
        bands: Sequence[int],
        plane: bool,
        resolution: tuple[int, int, int],
        folds: int,
    ) -> LearningData: ...
    @staticmethod
    def of_moment(given: npt.NDArray[np.float64], turn: bool) -> LearningData: ...
    @staticmethod
    def load(path: str | PathLike[str]) -> LearningData: ...
    def save(self, path: str | PathLike[str], name: str) -> None: ...
    @property
    def prior(self) -> npt.NDArray[np.float64]: ...

@final
class Material:
    @staticmethod
    def load(path: str | PathLike[str], name: str | None, wavelengths_nm: Sequence[float]) -> Material: ...
    @staticmethod
    def from_json(
        json: str, folder: str | PathLike[str], name: str | None, wavelengths_nm: Sequence[float]
    ) -> Material: ...
    @staticmethod
    def of_scene(scene: Scene, name: str | None, wavelengths_nm: Sequence[float]) -> Material: ...
    @property
    def name(self) -> str: ...
    def brdf(
        self, incoming: npt.NDArray[np.float64], outgoing: npt.NDArray[np.float64], uv: tuple[float, float]
    ) -> npt.NDArray[np.float32]: ...
    def specular(
        self, incoming: npt.NDArray[np.float64], transmitted: bool, uv: tuple[float, float]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]: ...

@final
class Medium:
    @staticmethod
    def load(path: str | PathLike[str], name: str | None, wavelengths_nm: Sequence[float]) -> Medium: ...
    @staticmethod
    def from_json(
        json: str, folder: str | PathLike[str], name: str | None, wavelengths_nm: Sequence[float]
    ) -> Medium: ...
    @staticmethod
    def of_scene(scene: Scene, name: str | None, wavelengths_nm: Sequence[float]) -> Medium: ...
    @property
    def name(self) -> str: ...
    def bulk(self) -> dict[str, npt.NDArray[np.float64]]: ...
    def evaluate(self, degrees: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]: ...

_Device = tuple[
    Sequence[int],
    Sequence[float],
    Sequence[float],
    Sequence[float],
    Sequence[Sequence[float]],
]
_Image = npt.NDArray[np.float64]

@final
class Devices:
    def __init__(self, camera: _Device, projector: _Device | None) -> None: ...
    @staticmethod
    def of_scene(scene: Scene) -> Devices | None: ...
    @property
    def camera(self) -> _Device: ...
    @property
    def projector(self) -> _Device: ...

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
    prior: npt.NDArray[np.float64] | None,
    view: tuple[float, int, int] | None,
) -> tuple[npt.NDArray[Any], npt.NDArray[Any] | None]: ...
def capture(
    scheme: Scheme,
    matrices: npt.NDArray[np.float64],
    wavelengths_nm: Sequence[float],
    lanes: bool,
    with_: Any,
    /,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32] | None, list[int]]: ...
def learn(
    template: Scheme,
    data: LearningData | None,
    asked: Any,
    progress: Callable[[int, int], object] | None,
) -> tuple[Scheme, tuple[float, float, float], list[tuple[str, float, npt.NDArray[np.float64]]]]: ...
def import_mitsuba(
    text: str,
    path: str | PathLike[str],
    parameters: dict[str, str],
    files: Sequence[tuple[str, bytes]],
) -> tuple[Scene | None, list[str], list[tuple[str, int | None, int | None, str, str | None]]]: ...
def applications_json() -> str: ...
def run_application(asked: Any, progress: Callable[[int, int], object] | None) -> tuple[str, list[dict[str, Any]]]: ...
def code_patterns(code: str, columns: int, periods: Sequence[float] | None) -> _Image: ...
def decode_columns(
    code: str, captures: _Image, columns: int, periods: Sequence[float] | None, least_contrast: float
) -> tuple[_Image, _Image]: ...
def triangulate(devices: Devices, columns: _Image) -> _Image: ...
def normals_of_depth(devices: Devices, depth: _Image, radius: int, robust: bool) -> _Image: ...
def polarization_cues(matrices: _Image, index: float, mirrored: bool, mirrored_off: bool) -> _Image: ...
def normals_of_cues(devices: Devices, cues: _Image, guess: _Image) -> _Image: ...
