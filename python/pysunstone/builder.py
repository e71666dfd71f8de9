"""A builder for scenes in code, with meshes and images from NumPy arrays."""

from __future__ import annotations

from typing import Any

from pysunstone.scene import Path, Scene

__all__ = ["SceneBuilder"]


#: Parts of a scene that a builder counts in its display.
_COUNTED = ("emitters", "materials", "media", "objects", "slices")


def _posed(origin: Any, target: Any, keys: dict[str, Any]) -> dict[str, Any]:
    if origin is None and target is None:
        return keys
    return {"pose": {"look_at": {"origin": origin, "target": target}}, **keys}


class SceneBuilder:
    """Builds a `Scene`.

    Every method accepts the keys of the corresponding table of a scene file (``docs/scene-files.md``) and returns the builder.

    Examples
    --------
    >>> import pysunstone as ps
    >>> scene = (
    ...     ps.SceneBuilder("ball")
    ...     .camera([0, 0.5, 3], [0, 0, 0], fov_x_deg=45, resolution=[64, 48])
    ...     .projector([1, 1, 3], [0, 0, 0], fov_x_deg=50, resolution=[64, 64])
    ...     .material("wall", diffuse={"albedo": 0.6})
    ...     .mesh("tile", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], material="wall")
    ...     .slice("mueller", polarization="mueller")
    ...     .render(spp=16)
    ...     .build()
    ... )  # doctest: +SKIP
    """

    def __init__(self, name: str | None = None, *, wavelengths_nm: Any = None, folder: Path = ".") -> None:
        self._document: dict[str, Any] = {"name": name, "wavelengths_nm": wavelengths_nm}
        self._folder = folder
        self._meshes: dict[str, Any] = {}
        self._images: dict[str, Any] = {}

    def __repr__(self) -> str:
        given = {key: value for key, value in self._document.items() if value is not None}
        parts = [f"{len(value)} {key}" if key in _COUNTED else key for key, value in given.items()]
        return f"<pysunstone.SceneBuilder, {', '.join(parts)}>"

    def _named(self, table: str, name: str, keys: dict[str, Any]) -> SceneBuilder:
        self._document.setdefault(table, {})[name] = keys
        return self

    def _listed(self, table: str, keys: dict[str, Any]) -> SceneBuilder:
        self._document.setdefault(table, []).append(keys)
        return self

    def camera(self, origin: Any = None, target: Any = None, **keys: Any) -> SceneBuilder:
        """Set the camera, with ``origin`` and ``target`` (metres), or with the key ``pose``."""
        self._document["camera"] = _posed(origin, target, keys)
        return self

    def projector(self, origin: Any = None, target: Any = None, **keys: Any) -> SceneBuilder:
        """Set the projector, with the same arguments as for the camera."""
        self._document["projector"] = _posed(origin, target, keys)
        return self

    def emitter(self, **keys: Any) -> SceneBuilder:
        """Add an emitter."""
        return self._listed("emitters", keys)

    def material(self, name: str, **keys: Any) -> SceneBuilder:
        """Add a material, or replace the material of this name."""
        return self._named("materials", name, keys)

    def medium(self, name: str, **keys: Any) -> SceneBuilder:
        """Add a medium, or replace the medium of this name."""
        return self._named("media", name, keys)

    def object(self, **keys: Any) -> SceneBuilder:
        """Add an object."""
        return self._listed("objects", keys)

    def mesh(self, name: str, vertices: Any, faces: Any, *, normals: Any = None, uvs: Any = None, **keys: Any) -> SceneBuilder:
        """Add an object with a mesh from arrays: vertices (n, 3) in metres, faces (m, 3) from 0; keys as for `object`."""
        self._meshes[name] = {"vertices": vertices, "faces": faces, "normals": normals, "uvs": uvs}
        return self.object(shape={"ply": {"file": name}}, **keys)

    def image(self, name: str, pixels: Any) -> SceneBuilder:
        """Add an image under a name that textures and slices use; see `Scene.from_dict`."""
        self._images[name] = pixels
        return self

    def slice(self, name: str, **keys: Any) -> SceneBuilder:
        """Add a slice."""
        return self._listed("slices", {"name": name, **keys})

    def render(self, **keys: Any) -> SceneBuilder:
        """Set render options: ``spp``, ``max_depth``, ``seed``, ``integrator``, ..."""
        self._document.setdefault("render", {}).update(keys)
        return self

    def build(self) -> Scene:
        """Build the scene; raise `InputError` with the location of an error."""
        return Scene.from_dict(self._document, folder=self._folder, meshes=self._meshes, images=self._images)
