"""Provides Mueller images of a data set of variants to PyTorch. This module does not import PyTorch."""

# pyright: basic
from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import zarr

from .dataset import DatasetError, manifest, open_dataset
from .plots import lane

__all__ = ["MuellerImages"]


class MuellerImages:
    """A map-style data set of pairs (image, parameters) for PyTorch, as NumPy arrays that its `DataLoader` collates.

    Parameters
    ----------
    path
        Folder of a finished data set.
    slice
        The slice to read.
    parameters
        Names of the parameters to return, in this order; by default all numeric parameters.
    wavelength
        Wavelength in nanometres: return only this wavelength, at most 0.5 nm from a wavelength of the data set.
    normalized
        Divide images by M00, except M00 itself; pixels without light are 0. Requires Mueller matrices.
    transform
        Function that is applied to every image.

    Notes
    -----
    An image is float32 with the axes of the slice, y and x last; usually (stokes_out, stokes_in, wavelength, y, x). Every worker
    process opens the store separately.

    Examples
    --------
    >>> images = MuellerImages("room.zarr", "polarimetric")               # doctest: +SKIP
    >>> loader = torch.utils.data.DataLoader(images, batch_size=8, shuffle=True, num_workers=2)  # doctest: +SKIP
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        slice: str,
        *,
        parameters: Iterable[str] | None = None,
        wavelength: float | None = None,
        normalized: bool = False,
        transform: Callable[[npt.NDArray[np.float32]], Any] | None = None,
    ) -> None:
        data = open_dataset(path, chunks=None)
        if slice not in data.children:
            raise DatasetError(f"{path} has no slice `{slice}`; available slices: {', '.join(data.children)}")
        view = data.children[slice].to_dataset()
        self._path, self._slice = os.fspath(path), slice
        drawn = manifest(path)["samples"][0]["values"]
        numbers = [name for name in drawn if "labels" not in view[name].attrs]
        self.parameters = list(numbers if parameters is None else parameters)
        if strange := [name for name in self.parameters if name not in drawn]:
            raise DatasetError(f"{path} has no parameter `{strange[0]}`; available parameters: {', '.join(drawn)}")
        values = [np.asarray(view[name].values, dtype=np.float32).reshape(view.sizes["sample"], -1) for name in self.parameters]
        self._values = np.concatenate(values, axis=1) if values else np.zeros((view.sizes["sample"], 0), np.float32)
        axes = [str(d) for d in view["mean"].dims if d != "sample"]
        pick = [d for d in axes if d in ("y", "x")]
        self.dims = [d for d in axes if d not in pick] + pick
        self._order = [axes.index(d) for d in self.dims]
        self._lane: tuple[int, int] | None = None
        if wavelength is not None:
            self._lane = lane(view["wavelength"].values, wavelength), self.dims.index("wavelength")
            self.dims.remove("wavelength")
        if normalized and not {"stokes_out", "stokes_in"} <= set(axes):
            raise DatasetError(f"slice `{slice}` has no Mueller matrices to normalize by M00")
        self._normalized = normalized
        self._transform = transform
        self._opened: tuple[int, zarr.Array[Any]] | None = None

    def __len__(self) -> int:
        return int(self._values.shape[0])

    def _array(self) -> zarr.Array[Any]:
        # Zarr's threads do not exist in a forked process.
        if self._opened is None or self._opened[0] != os.getpid():
            array = zarr.open_group(self._path, mode="r")[f"{self._slice}/mean"]
            assert isinstance(array, zarr.Array)
            self._opened = (os.getpid(), array)
        return self._opened[1]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_opened": None}

    def __getitem__(self, index: int) -> tuple[Any, npt.NDArray[np.float32]]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"sample {index} does not exist; the data set has {len(self)} samples")
        index %= len(self)
        image = np.asarray(self._array()[index])
        image = image.transpose(self._order)
        if self._lane is not None:
            image = image.take(*self._lane)
        image = np.ascontiguousarray(image, dtype=np.float32)
        if self._normalized:
            image = self._over_intensity(image)
        return (self._transform(image) if self._transform else image), self._values[index]

    def _over_intensity(self, image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        out, into = self.dims.index("stokes_out"), self.dims.index("stokes_in")
        matrices = np.moveaxis(image, (out, into), (0, 1))
        intensity = matrices[0, 0].copy()
        lit = intensity > 0
        result: npt.NDArray[np.float32] = np.where(lit, matrices / np.where(lit, intensity, 1), 0).astype(np.float32)
        result[0, 0] = intensity
        return np.ascontiguousarray(np.moveaxis(result, (0, 1), (out, into)))
