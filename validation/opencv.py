#!/usr/bin/env python3
"""Compare the projection of cameras and projectors with OpenCV's lenses with cv2.projectPoints and cv2.fisheye.projectPoints.

For each distortion model, a scene is written whose camera and projector have separate random coefficients in OpenCV's order: the
camera as `opencv_matrix`, `opencv` (or `fisheye`) and R, t; the projector with fx, fy, cx, cy shifted by half a pixel and rvec,
tvec. `sunstone project` then gives the pixels of 1,000 random visible points each, which must be within 1e-3 pixels of OpenCV's.
The camera is also written by cv2.FileStorage and read by `sunstone import`, and must give the same pixels. Last, small disks are
rendered with the strongest lenses. The centroid of each disk in the image, and of the projector pixels that illuminate it (first
moments over s'), must be within 0.15 pixels of OpenCV's position of the centre. Exits with 1 if a row is above its bound.

`--power` applies errors to Sunstone's input, one at a time (cx off by half a pixel, p1 and p2 exchanged, k3 in third place, R
transposed, a reflection of y), and checks that every row affected detects them.
"""

import argparse
import csv
import io
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import cv2
    import numpy as np

COUNT = 1000
BOUND = 1e-3
RENDERED_BOUND = 0.15
SIZE = {"camera": (640, 480), "projector": (912, 570)}
# Standard deviations of k1, k2, p1, p2, k3, k4, k5, k6, s1..s4, tau_x, tau_y.
SPREAD = [0.1, 0.05, 3e-3, 3e-3, 0.02, 0.06, 0.03, 0.01, 4e-3, 2e-3, 4e-3, 2e-3, 0.05, 0.05]
MODELS = {"Brown-Conrady": 5, "rational": 8, "thin prism": 12, "tilt": 14, "fisheye": 4}


class Device:
    """A calibrated device with OpenCV's parameters."""

    def __init__(self, model, name, size, rng):
        self.fisheye, self.size, count = model == "fisheye", size, MODELS[model]
        w, h = size
        f = w * (0.5 if self.fisheye else 1.0)
        fx, fy = f * rng.uniform(0.98, 1.02, 2)
        cx, cy = w / 2 + rng.uniform(-15, 15), h / 2 + rng.uniform(-15, 15)
        self.matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        spread = [0.02, 0.01, 0.004, 0.002] if self.fisheye else SPREAD[:count]
        self.lens = rng.normal(size=count) * spread
        # The camera in front of the origin, the projector to its right; both look approximately along -z.
        self.rvec = np.array([np.pi, 0, 0]) + rng.normal(size=3) * 0.05
        self.rotation = cv2.Rodrigues(self.rvec)[0]
        self.rvec = cv2.Rodrigues(self.rotation)[0].ravel()
        at = np.array([0.35 if name == "projector" else 0.0, 0.02, 2.0])
        self.tvec = -self.rotation @ at

    def project(self, points):
        """Return OpenCV's pixels of world points."""
        if self.fisheye:
            pixels, _ = cv2.fisheye.projectPoints(points[:, None, :], self.rvec, self.tvec, self.matrix, self.lens)
        else:
            pixels, _ = cv2.projectPoints(points, self.rvec, self.tvec, self.matrix, self.lens)
        return pixels[:, 0, :]

    def sees(self, points):
        """Return OpenCV's pixels, and which points are well inside the image, in front of the device, and where distortion is
        moderate.
        """
        local = points @ self.rotation.T + self.tvec
        pixels = self.project(points)
        w, h = self.size
        inside = ((pixels > 1) & (pixels < [w - 2, h - 2])).all(axis=1) & (local[:, 2] > 0.1)
        slope = np.abs(local[:, :2] / local[:, 2:]).max(axis=1)
        return pixels, inside & (slope < (8 if self.fisheye else 1.0))

    def as_camera(self):
        """Return TOML with OpenCV's parameters."""
        key = "fisheye" if self.fisheye else "opencv"
        return (f"opencv_matrix = {listed(self.matrix)}\n{key} = {listed(self.lens)}\n"
                f"pose.extrinsics = {{ R = {listed(self.rotation)}, t = {listed(self.tvec)} }}\n")

    def as_projector(self):
        """Return TOML with focal length, Sunstone's principal point and a rotation vector."""
        key, m = "fisheye" if self.fisheye else "opencv", self.matrix
        return (f"fx = {m[0, 0]!r}\nfy = {m[1, 1]!r}\ncx = {m[0, 2] + 0.5!r}\ncy = {m[1, 2] + 0.5!r}\n".replace("np.float64", "")
                .replace("(", "").replace(")", "") + f"{key} = {listed(self.lens)}\n"
                f"pose.extrinsics = {{ rvec = {listed(self.rvec)}, tvec = {listed(self.tvec)} }}\n")

    def calibration(self, path):
        """Write a file in the format of OpenCV's calibration programs."""
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for name, value in zip(("image_width", "image_height"), self.size):
            file.write(name, value)
        file.write("camera_matrix", self.matrix)
        file.write("distortion_coefficients", self.lens[None])
        if self.fisheye:
            file.write("distortion_model", "fisheye")
        file.write("R", self.rotation)
        file.write("t", self.tvec[:, None])
        file.release()


def listed(values):
    """Format an array as TOML and JSON."""
    return json.dumps(np.asarray(values).tolist())


def scene(cameras, more=""):
    """Return a scene of two devices as TOML."""
    out = "wavelengths_nm = [550]\n"
    for name, text in cameras.items():
        out += f"[{name}]\nresolution = {list(SIZE[name])}\n{text}"
    return out + (more or "[[slices]]\nname = \"image\"\n")


def run(*arguments, folder):
    """Return the program's output."""
    done = subprocess.run([environment.sunstone(), *arguments], cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"sunstone {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def projected(text, points, folder):
    """Return Sunstone's pixels by device, in OpenCV's pixel coordinates; NaN for invisible points."""
    (folder / "scene.toml").write_text(text)
    with open(folder / "points.csv", "w") as file:
        csv.writer(file).writerows(points.tolist())
    rows = list(csv.reader(io.StringIO(run("project", "scene.toml", "points.csv", "--opencv", folder=folder))))[1:]
    pixels = np.array([[float(x or "nan") for x in row[3:]] for row in rows])
    return {"camera": pixels[:, :2], "projector": pixels[:, 2:]}


def visible(device, rng):
    """Return random points that a device sees."""
    found, w = [], 4.0 if device.fisheye else 0.7
    while sum(map(len, found)) < COUNT:
        z = rng.uniform(0.3, 4, 4 * COUNT)
        local = np.stack([rng.uniform(-w, w, z.size) * z, rng.uniform(-w, w, z.size) * z, z], axis=1)
        points = (local - device.tvec) @ device.rotation
        points = points.astype(np.float32).astype(float)
        found.append(points[device.sees(points)[1]])
    return np.concatenate(found)[:COUNT]


def worst(got, want):
    """Return the largest distance in pixels; infinite if a point is not seen."""
    return np.nan_to_num(np.linalg.norm(got - want, axis=1), nan=np.inf).max()


def imported(device, folder, kind):
    """Return the scene text of the camera that `sunstone import` makes from OpenCV's own file."""
    device.calibration(folder / f"calibration.{kind}")
    text = run("import", f"calibration.{kind}", "-o", "camera.toml", "--force", folder=folder)
    assert "camera.toml" in text, text
    return (folder / "camera.toml").read_text()


def compare(model, seed, folder):
    """Return rows of one model: name, largest distance."""
    rng = np.random.default_rng(seed)
    devices = {name: Device(model, name, size, rng) for name, size in SIZE.items()}
    text = scene({"camera": devices["camera"].as_camera(), "projector": devices["projector"].as_projector()})
    for name, device in devices.items():
        points = visible(device, rng)
        yield f"{model}, {name}", worst(projected(text, points, folder)[name], device.project(points))
        if name == "camera":
            for kind in ("yaml", "json"):
                own = imported(device, folder, kind) + "[[emitters]]\npoint = { position = [0, 0, 1], intensity = 1 }\n"
                pixels = projected(own, points, folder)["camera"]
                yield f"{model}, camera of cv2's .{kind}", worst(pixels, device.project(points))


# Effects of errors on a device, only in Sunstone.
def half_a_pixel(device):
    device.matrix[0, 2] += 0.5


def exchanged(device):
    device.lens[[2, 3]] = device.lens[[3, 2]]


def third(device):
    device.lens = np.concatenate([device.lens[[0, 1, 4, 2, 3]], device.lens[5:]])


def transposed(device):
    device.rotation = device.rotation.T
    device.rvec = -device.rvec


def upside_down(device):
    device.rotation, device.tvec = np.diag([-1, -1, 1]) @ device.rotation, np.diag([-1, -1, 1]) @ device.tvec
    device.rvec = cv2.Rodrigues(device.rotation)[0].ravel()


ERRORS = {"cx off by half a pixel": half_a_pixel, "p1 and p2 exchanged": exchanged, "k3 in third place": third,
          "R transposed": transposed, "x and y turned round": upside_down}


def power(seed, folder):
    """Apply every error to every model; return true if one is not detected."""
    failed = False
    for model in MODELS:
        for error, change in ERRORS.items():
            if model == "fisheye" and change in (exchanged, third):
                continue
            rng = np.random.default_rng(seed)
            devices = {name: Device(model, name, size, rng) for name, size in SIZE.items()}
            wrong = {}
            for name in SIZE:
                spoilt = Device.__new__(Device)
                spoilt.__dict__ = {k: np.copy(v) if isinstance(v, np.ndarray) else v for k, v in vars(devices[name]).items()}
                change(spoilt)
                wrong[name] = spoilt
            text = scene({"camera": wrong["camera"].as_camera(), "projector": wrong["projector"].as_projector()})
            for name, device in devices.items():
                points = visible(device, rng)
                found = worst(projected(text, points, folder)[name], device.project(points)) > BOUND
                failed |= not found
                print(f"{error:24} {model + ', ' + name:24} {'detected' if found else 'NOT DETECTED'}")
    return failed


DISKS = 8


def rendered(model, seed, folder, change=None):
    """Return the largest distance of rendered centroids of small disks from OpenCV's positions of their centres: camera,
    projector.
    """
    rng = np.random.default_rng(seed)
    devices = {name: Device(model, name, size, rng) for name, size in SIZE.items()}
    given = {"camera": devices["camera"].as_camera(), "projector": devices["projector"].as_projector()}
    if change:
        spoilt = {name: Device.__new__(Device) for name in devices}
        for name, device in devices.items():
            spoilt[name].__dict__ = {k: np.copy(v) if isinstance(v, np.ndarray) else v for k, v in vars(device).items()}
            change(spoilt[name])
        given = {"camera": spoilt["camera"].as_camera(), "projector": spoilt["projector"].as_projector()}
    points = visible(devices["camera"], rng)
    local = points @ devices["camera"].rotation.T + devices["camera"].tvec
    both = devices["projector"].sees(points)[1] & (np.linalg.norm(local[:, :2], axis=1) < 2 * local[:, 2]) & (local[:, 2] > 1)
    chosen = []
    pixels = devices["camera"].project(points)
    w, h = SIZE["camera"]
    for i in np.flatnonzero(both):
        clear = (np.abs(pixels[i] - [w / 2, h / 2]) < [w / 2 - 12, h / 2 - 12]).all()
        shadow = [devices["projector"].project(points[[i, j]]) for j in chosen]
        if clear and all(np.linalg.norm(pixels[i] - pixels[j]) > 40 for j in chosen) and all(
                np.linalg.norm(a - b) > 40 for a, b in shadow):
            chosen.append(i)
        if len(chosen) == DISKS:
            break
    assert len(chosen) == DISKS, "too few points are visible to both devices"
    more = "[materials]\nwhite.diffuse.albedo = 0.8\n[render]\nspp = 64\nmax_depth = 2\n"
    eye = -devices["camera"].rotation.T @ devices["camera"].tvec
    for i in chosen:
        facing = eye - points[i]
        radius = 3.0 * np.linalg.norm(facing) / devices["camera"].matrix[0, 0]
        more += ("[[objects]]\nmaterial = \"white\"\n"
                 f"shape.disk = {{ center = {listed(points[i])}, normal = {listed(facing)}, radius = {radius} }}\n")
    for name, drive in (("sum", '"sum"'), ("u", '{ moment = "u" }'), ("v", '{ moment = "v" }')):
        more += f"[[slices]]\nname = \"{name}\"\nprojector = {drive}\n"
    (folder / "disks.toml").write_text(scene(given, more))
    run("render", "disks.toml", "-o", "disks.zarr", "--no-figures", "--force", folder=folder)
    images = {}
    for name in ("sum", "u", "v"):
        run("probe", "disks.zarr", name, "--sum", "wavelength", "-o", f"{name}.npy", "--force", folder=folder)
        images[name] = np.load(folder / f"{name}.npy").reshape(h, w).astype(float)
    y, x = np.mgrid[:h, :w]
    off = []
    for i in chosen:
        near = (np.abs(x - pixels[i][0]) < 15) & (np.abs(y - pixels[i][1]) < 15)
        light = images["sum"] * near
        total = light.sum()
        if not total > 0:
            return np.inf, np.inf
        seen = np.array([(light * x).sum(), (light * y).sum()]) / total
        lit = np.array([(images["u"] * near).sum(), (images["v"] * near).sum()]) / total
        off.append([np.linalg.norm(seen - pixels[i]), np.linalg.norm(lit - devices["projector"].project(points[[i]])[0])])
    return np.array(off).max(axis=0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    parser.add_argument("--seed", type=int, default=1, help="seed of coefficients, poses and points")
    a = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        if a.power:
            failed = power(a.seed, folder)
            for name, distance in zip(("image", "s'"), rendered("tilt", a.seed, folder, half_a_pixel)):
                failed |= not distance > RENDERED_BOUND
                print(f"{'cx off by half a pixel':24} {'rendered ' + name:24} "
                      f"{'detected' if distance > RENDERED_BOUND else 'NOT DETECTED'} ({distance:.2f} px)")
            sys.exit(1 if failed else 0)
        print(f"{'1,000 points':36} {'largest distance, pixels':>26} {'bound':>7}")
        for model in MODELS:
            for name, distance in compare(model, a.seed, folder):
                failed |= not distance < BOUND
                print(f"{name:36} {distance:26.2e} {BOUND:7.0e}", flush=True)
        for model in ("tilt", "fisheye"):
            for name, distance in zip(("image", "s'"), rendered(model, a.seed, folder)):
                failed |= not distance < RENDERED_BOUND
                print(f"{f'{DISKS} rendered disks, {model}, {name}':36} {distance:26.3f} {RENDERED_BOUND:7.2f}", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
