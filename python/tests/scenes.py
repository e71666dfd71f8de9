"""A small test scene: a gold sphere in front of a wall, and a camera with 24 × 16 pixels."""

from __future__ import annotations

from typing import Any

TEXT = """
name = "ball"
[render]
spp = 16
tile = 8
[camera]
resolution = [24, 16]
fov_x_deg = 45
pose.look_at = { origin = [0, 0.5, 3], target = [0, 0, 0] }
[projector]
resolution = [16, 16]
fov_x_deg = 50
pose.look_at = { origin = [1, 1, 3], target = [0, 0, 0] }
[materials]
gold.rough_conductor = { n = [1.3831, 0.4242, 0.1399], k = [1.9155, 2.4721, 3.7015], alpha = 0.2 }
wall.diffuse.albedo = 0.6
[[objects]]
shape.sphere = { center = [0, 0, 0], radius = 0.6 }
material = "gold"
[[objects]]
shape.rectangle = { corner = [-2, -2, -1], u = [4, 0, 0], v = [0, 4, 0] }
material = "wall"
[[slices]]
name = "mueller"
polarization = "mueller"
[[slices]]
name = "time"
time = { start_ps = 15000, bin_ps = 500, bins = 40 }
"""


def document(**changes: Any) -> dict[str, Any]:
    """Return the same scene as a dict."""
    look: Any = lambda o: {"look_at": {"origin": o, "target": [0, 0, 0]}}  # noqa: E731
    scene: dict[str, Any] = {
        "name": "ball",
        "render": {"spp": 16, "tile": 8},
        "camera": {"resolution": [24, 16], "fov_x_deg": 45, "pose": look([0, 0.5, 3])},
        "projector": {"resolution": [16, 16], "fov_x_deg": 50, "pose": look([1, 1, 3])},
        "materials": {
            "gold": {"rough_conductor": {"n": [1.3831, 0.4242, 0.1399], "k": [1.9155, 2.4721, 3.7015], "alpha": 0.2}},
            "wall": {"diffuse": {"albedo": 0.6}},
        },
        "objects": [
            {"shape": {"sphere": {"center": [0, 0, 0], "radius": 0.6}}, "material": "gold"},
            {"shape": {"rectangle": {"corner": [-2, -2, -1], "u": [4, 0, 0], "v": [0, 4, 0]}}, "material": "wall"},
        ],
        "slices": [
            {"name": "mueller", "polarization": "mueller"},
            {"name": "time", "time": {"start_ps": 15000, "bin_ps": 500, "bins": 40}},
        ],
    }
    return scene | changes
