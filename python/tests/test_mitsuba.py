"""Scenes of Mitsuba, written as for `mi.load_dict` and rendered by both programs. Errors name the keys of items that cannot be
converted.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pysunstone as ps

ROOT = Path(__file__).resolve().parents[2]
mi: Any = pytest.importorskip("mitsuba")

SEEDS, THEIR_SPP, OUR_SPP = 8, 64, 512


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("scalar_rgb")


def quiet(scene: Any, **options: Any) -> ps.Scene:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ps.from_mitsuba(scene, **options)


def box() -> dict[str, Any]:
    """Return the dict of `mi.cornell_box`, small, with a box filter."""
    scene: dict[str, Any] = mi.cornell_box()
    scene["integrator"]["max_depth"] = 5
    scene["sensor"]["film"] |= {"width": 20, "height": 20, "rfilter": {"type": "box"}}
    return scene


def theirs(scene: dict[str, Any]) -> tuple[Any, Any]:
    """Return mean and standard error of red, green, blue, over seeds."""
    loaded = mi.load_dict(scene)
    images = np.stack([np.array(mi.render(loaded, spp=THEIR_SPP, seed=seed))[..., :3] for seed in range(SEEDS)])
    return images.mean(0), images.std(0, ddof=1) / SEEDS**0.5


def ours(scene: Any) -> tuple[Any, Any]:
    """Return mean and standard error of Sunstone's render, with 660, 550 and 450 nm as red, green and blue."""
    made = quiet(scene).render(spp=OUR_SPP, seed=3)["mueller"]
    return made["mean"][:, :, 0, 0, ::-1].astype(float), made["std_error"][:, :, 0, 0, ::-1].astype(float)


def off(a: tuple[Any, Any], b: tuple[Any, Any]) -> tuple[float, float]:
    """Return the differences in units of standard errors: of the mean image (worst colour), and RMS over pixels."""
    error = np.hypot(a[1], b[1])
    whole = abs((a[0] - b[0]).mean((0, 1))) / np.sqrt((error**2).mean((0, 1)) / error[..., 0].size)
    lit = error > 0
    return float(whole.max()), float(np.sqrt((((a[0] - b[0])[lit] / error[lit]) ** 2).mean()))


def test_a_dict_renders_as_in_mitsuba() -> None:
    """Standard errors are from 8 batches: z follows Student's t with 7 degrees of freedom and standard deviation 1.18."""
    scene = box()
    # Typical inputs: a mesh, an image, another material, a point light, an array, a nested dict.
    rng = np.random.default_rng(1)
    scene["image"] = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0.2, -0.95]).scale(0.5),
        "bsdf": {
            "type": "twosided",
            "material": {
                "type": "diffuse",
                "reflectance": {"type": "bitmap", "bitmap": mi.Bitmap(rng.random((4, 6, 3), dtype=np.float32)), "filter_type": "nearest"},
            },
        },
    }
    scene["ball"] = {
        "type": "sphere",
        "center": np.array([-0.3, 0.5, -0.2]),
        "radius": np.float32(0.25),
        "bsdf": {"type": "roughconductor", "alpha": 0.3, "distribution": "ggx", "eta": 0.4, "k": 2.5},
    }
    scene["lamp"] = {"type": "point", "position": mi.ScalarPoint3f(0.2, 0.3, 0.9), "intensity": {"type": "rgb", "value": (0.3, 0.2, 0.5)}}
    mesh = mi.load_dict({"type": "cube", "to_world": mi.ScalarTransform4f().translate([0.6, 0.3, 0.2]).scale(0.15)})
    scene["mesh"] = mesh
    reference, found = theirs(scene), ours(scene)
    mean, each = off(found, reference)
    assert mean < 5 and each < 1.5, (mean, each)
    # Negative controls: the image upside down, 5 % more light, and red and blue exchanged.
    assert off((found[0][::-1], found[1]), reference)[1] > 5
    assert off((found[0] * 1.05, found[1]), reference)[0] > 5
    assert off((found[0][..., ::-1], found[1]), reference)[1] > 5


def screen(**bitmap: Any) -> dict[str, Any]:
    """Return a colour image under a uniform sky."""
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "perspective",
            "fov": 30,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 3], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 12, "height": 12, "rfilter": {"type": "box"}},
        },
        "sky": {"type": "constant"},
        "screen": {
            "type": "rectangle",
            "bsdf": {"type": "twosided", "inner": {"type": "diffuse", "reflectance": {"type": "bitmap", "filter_type": "nearest", **bitmap}}},
        },
    }


@pytest.mark.parametrize("kind", ["exr", "exr raw", "png", "png raw", "bitmap", "bitmap of bytes", "data"])
def test_images_are_decoded_as_in_mitsuba(kind: str, tmp_path: Path) -> None:
    """Colours under a sky of radiance 1 equal those of the image. Only values of encoded formats are decoded."""
    image = np.random.default_rng(2).random((3, 5, 3), dtype=np.float32)
    mi.Bitmap(image).write(str(tmp_path / "i.exr"))
    mi.Bitmap((image * 255).astype(np.uint8)).write(str(tmp_path / "i.png"))
    of: dict[str, dict[str, Any]] = {
        "exr": {"filename": str(tmp_path / "i.exr")},
        "exr raw": {"filename": tmp_path / "i.exr", "raw": True},
        "png": {"filename": str(tmp_path / "i.png")},
        "png raw": {"filename": str(tmp_path / "i.png"), "raw": True},
        "bitmap": {"bitmap": mi.Bitmap(image)},
        "bitmap of bytes": {"bitmap": mi.Bitmap((image * 255).astype(np.uint8))},
        "data": {"data": mi.TensorXf(image)},
    }
    found = ours(screen(**of[kind]))[0]
    # Mitsuba may consume a tensor that it loads.
    fresh = {"data": mi.TensorXf(image)} if kind == "data" else {k: str(v) if k == "filename" else v for k, v in of[kind].items()}
    want = theirs(screen(**fresh))[0]
    assert abs(found - want).max() < 0.12 and abs(found - want).mean() < 0.02
    # Negative controls: images that are decoded twice or not at all, or are upside down.
    assert abs(want**2.2 - found).mean() > 0.05 and abs(found[::-1] - want).mean() > 0.1


def test_meshes_built_in_memory_are_read() -> None:
    mesh = mi.Mesh("hand", vertex_count=4, face_count=2)
    params = mi.traverse(mesh)
    params["vertex_positions"] = [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]
    params["faces"] = [0, 1, 2, 0, 2, 3]
    params.update()
    scene = screen(filename="none")
    scene["screen"] = mesh
    plain = screen(filename="none")
    plain["screen"] = {"type": "rectangle"}
    a, b = (quiet(s).render(spp=16)["mueller"]["mean"] for s in (scene, plain))
    assert abs(a - b).max() < 1e-3 * b.max() and b[6, 6, 0, 0, 0] > 0.4


def test_texts_and_files_are_read() -> None:
    path = ROOT / "validation/scenes_exchange/by_hand.xml"
    scene = quiet(path, wavelengths_nm=[550])
    assert scene.wavelengths_nm == [550] and scene.slices == ["mueller"]
    again = quiet(path.read_text(), folder=path.parent, parameters={"wavelengths_nm": 550})
    assert again.sha256 == scene.sha256
    minimal = '{"type": "scene", "s": {"type": "perspective"}, "l": {"type": "constant"}, "b": {"type": "sphere"}}'
    assert quiet(minimal).sha256 == quiet({"type": "scene", "s": {"type": "perspective"}, "l": {"type": "constant"}, "b": {"type": "sphere"}}).sha256


def test_lost_properties_are_reported() -> None:
    scene = mi.cornell_box()
    scene["mesh"] = mi.load_dict({"type": "cube"})
    with pytest.warns(UserWarning) as reported:
        ps.from_mitsuba(scene)
    messages = [str(w.message) for w in reported]
    assert any("mesh: a mesh does not expose its material" in s for s in messages), messages


def test_vectorized_variants_are_read() -> None:
    if "llvm_ad_rgb" not in mi.variants():
        pytest.skip("no LLVM")
    want = quiet(box()).sha256
    try:
        mi.set_variant("llvm_ad_rgb")
        scene = box()
        scene["green-wall"]["to_world"] = mi.Transform4f(scene["green-wall"]["to_world"].matrix)
    except (ImportError, RuntimeError):
        pytest.skip("no LLVM")
    assert quiet(scene).sha256 == want


def test_unsupported_items_are_named_by_their_key() -> None:
    def changed(**changes: Any) -> dict[str, Any]:
        return {**box(), **changes}

    sphere = {"type": "sphere", "bsdf": {"type": "hair"}}
    for scene, words in (
        (changed(ball=sphere), r"ball\.bsdf.*hair"),
        (changed(ball={"type": "sphere", "radius": float("nan")}), r"ball\.radius: it is nan"),
        (changed(ball={"type": "sphere", "radius": [1, 2]}), r"ball\.radius"),
        (changed(ball={"type": "sphere", "bsdf": {"type": "ref", "id": "none"}}), r"ball\.bsdf.*none"),
        (changed(ball={"type": "sphere", "bsdf": mi.load_dict({"type": "diffuse"})}), r"ball\.bsdf: a .* does not expose"),
        (changed(ball={"type": "sphere", "to_world": np.eye(4) * 2}), r"ball\.to_world"),
        (changed(ball={"type": "sphre"}), r"ball.*sphre"),
        (changed(ball={"type": "sphere", "colour": 3.0}), r"ball.*colour"),
        (changed(ball={"type": "sphere", "center": object()}), r"ball\.center: a object"),
        (changed(ball={"type": "sphere", 3: 1}), r"ball: its key 3"),
        (mi.load_dict(box()), "give the dict"),
        ({"type": "sphere"}, "expected a dictionary of type scene"),
        ("nothing.xml", r"nothing\.xml"),
        ("<scene version='3.0.0'><shape type='cone'/></scene>", "cone"),
    ):
        with pytest.raises(ps.InputError, match=words) as reported:
            ps.from_mitsuba(scene)
        assert reported.value.message and reported.value.fix or "nothing.xml" in str(reported.value) or "give the dict" in str(reported.value)
    # All faults are reported in one error.
    with pytest.raises(ps.InputError) as reported:
        ps.from_mitsuba(changed(ball=sphere, other={"type": "cone"}))
    assert "ball" in str(reported.value) and "other" in str(reported.value)
