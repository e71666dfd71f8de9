#!/usr/bin/env python3
"""Check calibrations of cameras and projectors on rendered boards, against the truth and against OpenCV.

A chessboard is in random poses in front of a camera with a lens of 5 coefficients (Brown–Conrady) or of 8 (rational). `sunstone
calibrate board` calibrates from the images. OpenCV calibrates from its own corners in the same images (`findChessboardCorners`
with `cornerSubPix`, and `findChessboardCornersSB`), and from Sunstone's corners. Then a projector shows its Gray codes on the
board, with all patterns as masks of one render, and `sunstone calibrate projector` calibrates both devices. The table has these
rows:

- corners: root mean square distance from the result of `cv2.projectPoints`
- RMS: Sunstone's RMS error divided by OpenCV's on the same images, with the better of OpenCV's corners: at most 1
- same corners: largest difference of focal lengths, centre and RMS from OpenCV's result with Sunstone's corners, in Sunstone's
  sigma
- truth: largest z-score of focal lengths and centre, of the lens (where the lens moves image points), and of all poses of the
  board; also the mean square of the poses' z-scores

Exits with 1 if a row is above its bound. `--power` applies errors one at a time (centre off by half a pixel, its x and y
exchanged, another size of squares, k3 and p1 exchanged, rotations transposed, errors stated three times too small, less accurate
corners), and checks that each error is detected. `--both` does both on the same images.
"""

import argparse
import csv
import json
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import cv2
    import numpy as np

COLUMNS, ROWS, SQUARE = 9, 6, 0.025
SIZE, PROJECTOR = (480, 360), (256, 192)
LENSES = {5: [-0.25, 0.1, 0.001, -0.0015, -0.02], 8: [0.5, 0.05, 0.001, -0.0015, 0.002, 0.85, 0.25, 0.01]}
VIEWS, SPP = 14, 16
PROJECTOR_VIEWS, PROJECTOR_SPP = 7, 8
BOUNDS = {"corners, pixels": 0.06, "RMS over OpenCV's": 1.0, "same corners, sigma": 0.05, "truth, z of f and c": 4.5,
          "truth, z of the lens": 4.5, "truth, z of poses": 5.5, "truth, mean z² of poses": 1.6, "truth, mean z² of all": 5.0}


def listed(values):
    """Format an array as TOML and JSON."""
    return json.dumps(np.asarray(values).tolist())


def run(*arguments, folder):
    """Return the program's output; exit if it fails."""
    done = subprocess.run([environment.sunstone(), *map(str, arguments)], cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"sunstone {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def points():
    """Return the board's corners."""
    return np.array([[i % COLUMNS * SQUARE, i // COLUMNS * SQUARE, 0] for i in range(COLUMNS * ROWS)])


class Device:
    """A device with OpenCV's parameters."""

    def __init__(self, size, focal, centre, lens):
        self.size, self.lens = size, np.array(lens)
        self.matrix = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1.0]])

    def project(self, pose, at):
        return cv2.projectPoints(at, pose[0], pose[1], self.matrix, self.lens)[0].reshape(-1, 2)

    def table(self, name, pose):
        return (f"[{name}]\nresolution = {list(self.size)}\nopencv_matrix = {listed(self.matrix)}\nopencv = {listed(self.lens)}\n"
                f"pose.extrinsics = {{ rvec = {listed(pose[0])}, tvec = {listed(pose[1])} }}\n")


def camera(count):
    return Device(SIZE, (378.0, 372.5), (243.2, 176.4), LENSES[count])


def projector():
    return Device(PROJECTOR, (240.0, 242.0), (131.0, 118.0), [-0.06, 0.03, 0.0008, -0.0005, 0.0])


BETWEEN = (np.array([0.04, -0.22, 0.02]), np.array([0.09, 0.035, 0.03]))


def after(outer, inner):
    """Return the pose that applies `inner` first, then `outer`."""
    rvec, tvec = cv2.composeRT(*[np.asarray(v, float).reshape(3, 1) for v in (*inner, *outer)])[:2]
    return rvec.ravel(), tvec.ravel()


def poses(device, count, rng, other=None):
    """Return tilted poses in which the whole board is visible and which together cover the image."""
    corners = np.array([[x, y, 0] for x in (-1.6, COLUMNS + 0.6) for y in (-1.6, ROWS + 0.6)]) * SQUARE
    found = []
    for _ in range(100_000):
        if len(found) == count:
            return found
        turn = rng.uniform(-0.65, 0.65, 2)
        rvec = np.array([*turn, rng.uniform(-0.3, 0.3)])
        if np.linalg.norm(turn) < 0.2:
            continue
        z = rng.uniform(0.2, 0.36) if other is None else rng.uniform(0.3, 0.5)
        middle = np.array([*(rng.uniform(-0.45, 0.45, 2) * z * [1, 0.75]), z])
        centre = np.array([(COLUMNS - 1) / 2, (ROWS - 1) / 2, 0]) * SQUARE
        pose = (rvec, middle - cv2.Rodrigues(rvec)[0] @ centre)
        seen = device.project(pose, corners)
        whole = ((seen > 2) & (seen < np.array(device.size) - 3)).all()
        local = corners @ cv2.Rodrigues(rvec)[0].T + pose[1]
        near = (np.linalg.norm(local[:, :2] / local[:, 2:], axis=1) < 1.25).all()
        if other is not None and whole:
            thrown = other.project(after(BETWEEN, pose), corners)
            whole = ((thrown > 2) & (thrown < np.array(other.size) - 3)).all()
        if whole and near:
            found.append(pose)
    sys.exit("both devices see no common pose of the board")


def scene(tables, more):
    """Return the board: 10 by 7 squares, black before the first corner, on white paper."""
    half, middle = np.array([COLUMNS + 1, ROWS + 1]) * SQUARE / 2, np.array([COLUMNS - 1, ROWS - 1]) * SQUARE / 2
    place = "rotate_deg = [180, 0, 0], translate"
    return (f"wavelengths_nm = [550]\n{tables}[render]\n{more}max_depth = 2\n"
            f"[materials]\nboard.diffuse.albedo = {{ checkerboard = [0.05, 0.8], uv = [[{(COLUMNS + 1) / 2}, 0, 0], [0, {(ROWS + 1) / 2}, 0]] }}\n"
            "paper.diffuse.albedo = 0.8\n"
            f"[[objects]]\nshape.rectangle = {{}}\nmaterial = \"board\"\n"
            f"transform = {{ scale = {listed([*half, 1])}, {place} = {listed([*middle, 0])} }}\n"
            f"[[objects]]\nshape.rectangle = {{}}\nmaterial = \"paper\"\n"
            f"transform = {{ scale = {listed([*(half + SQUARE), 1])}, {place} = {listed([*middle, 0.0003])} }}\n")


def photographs(device, all_poses, folder):
    """Render the views and return the paths of the images."""
    def one(i):
        more = ("[[emitters]]\nenvironment = { radiance = 1 }\n[[slices]]\nname = \"image\"\nprojector = \"ambient\"\n"
                "polarization = \"intensity\"\n")
        (folder / f"{i}.toml").write_text(scene(device.table("camera", all_poses[i]), f"spp = {SPP}\nseed = {i}\n") + more)
        run("render", f"{i}.toml", "-o", f"{i}.zarr", "--no-figures", "--force", "--threads", 1, folder=folder)
        run("probe", f"{i}.zarr", "image", "--sum", "wavelength", "-o", f"{i}.npy", "--force", folder=folder)
        return f"{i}.npy"
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(one, range(len(all_poses))))


def calibrated(folder, images, count, square=SQUARE):
    """Return Sunstone's calibration and its corners by image in OpenCV's pixel coordinates."""
    run("calibrate", "board", *images, "--columns", COLUMNS, "--rows", ROWS, "--square", f"{square * 1000:.6f}mm", "--lens", count,
        "-o", "ours.toml", "--corners", "corners.csv", folder=folder)
    ours = tomllib.loads((folder / "ours.toml").read_text())
    corners = {}
    for row in list(csv.reader(open(folder / "corners.csv")))[1:]:
        corners.setdefault(row[0], []).append([float(row[4]) - 0.5, float(row[5]) - 0.5])
    return ours, {name: np.array(c) for name, c in corners.items()}


def theirs(folder, images):
    """Return OpenCV's corners by image, if found: with the older and with the newer method."""
    older, newer = {}, {}
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    for name in images:
        image = np.load(folder / name)
        image = np.clip(image * 255, 0, 255).round().astype(np.uint8)
        found, corners = cv2.findChessboardCorners(image, (COLUMNS, ROWS))
        if found:
            older[name] = cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), stop).reshape(-1, 2)
        found, corners = cv2.findChessboardCornersSB(image, (COLUMNS, ROWS), flags=cv2.CALIB_CB_ACCURACY)
        if found:
            newer[name] = corners.reshape(-1, 2)
    return older, newer


def opencv(corners, count):
    """Return OpenCV's calibration from corners: RMS, matrix, coefficients."""
    flags = cv2.CALIB_RATIONAL_MODEL if count == 8 else 0
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 500, 1e-12)
    board = [points().astype(np.float32)] * len(corners)
    pixels = [c.astype(np.float32)[:, None, :] for c in corners.values()]
    rms, matrix, lens, *_ = cv2.calibrateCamera(board, pixels, SIZE, None, None, flags=flags, criteria=stop)
    return rms, matrix, lens.ravel()[:count]


def of(table):
    """Return a device of a calibration file."""
    m = np.array(table["opencv_matrix"])
    return Device(tuple(table["resolution"]), (m[0, 0], m[1, 1]), (m[0, 2], m[1, 2]), table["opencv"])


def f_and_c(device):
    m = device.matrix
    return np.array([m[0, 0], m[1, 1], m[0, 2], m[1, 2]])


def moved(parameters, size):
    """Return the image positions of a few directions for the parameters fx, fy, cx, cy and coefficients."""
    at = np.array([[x, y, 1.0] for x in (-0.45, 0, 0.45) for y in (-0.3, 0.05, 0.35)])
    device = Device(size, parameters[:2], parameters[2:4], parameters[4:])
    return device.project((np.zeros(3), np.zeros(3)), at).ravel()


def z_of_lens(device, truth, covariance):
    """Return z-scores of the image positions against the truth, with the covariance of the parameters."""
    here = np.array([*f_and_c(device), *device.lens])
    steps = np.maximum(np.abs(here), 0.1) * 1e-6
    slopes = np.array([(moved(here + s * e, device.size) - moved(here - s * e, device.size)) / (2 * s)
                       for s, e in zip(steps, np.eye(len(here)))]).T
    variance = np.einsum("ij,jk,ik->i", slopes, covariance, slopes)
    return (moved(here, device.size) - moved(np.array([*f_and_c(truth), *truth.lens]), truth.size)) / np.sqrt(variance)


def z_of_poses(ours, truth, images):
    """Return z-scores of the deviations of poses."""
    all_z = []
    for pose, errors, name in zip(ours["quality"]["poses"], ours["quality"]["poses_errors"], ours["quality"]["files"]):
        want = truth[images.index(name)]
        turn = cv2.Rodrigues(cv2.Rodrigues(np.array(pose[:3]))[0] @ cv2.Rodrigues(want[0])[0].T)[0].ravel()
        all_z.append(np.array([*turn, *(np.array(pose[3:]) - want[1])]) / errors)
    return np.concatenate(all_z)


def truth_rows(ours, name, truth):
    """Return the rows of one device against the truth."""
    device, errors = of(ours[name]), ours["quality"][f"{name}_errors"]
    z = (f_and_c(device) - f_and_c(truth)) / [errors[k] for k in ("fx", "fy", "cx", "cy")]
    names = ours["covariance"]["names"]
    of_device = [i for i, n in enumerate(names) if n.startswith(name + ".")]
    covariance = np.array(ours["covariance"]["rows"])[np.ix_(of_device, of_device)]
    return {"truth, z of f and c": np.abs(z).max(), "truth, z of the lens": np.abs(z_of_lens(device, truth, covariance)).max()}


def rows(ours, corners, own, same, truth, all_poses, images):
    """Return every row of a lens: name and value."""
    off = np.concatenate([corners[n] - truth.project(all_poses[images.index(n)], points()) for n in corners])
    out = {"corners, pixels": np.sqrt((off**2).sum(axis=1).mean())}
    out["RMS over OpenCV's"] = ours["quality"]["rms_px"][0] / own[0]
    errors = ours["quality"]["camera_errors"]
    apart = (f_and_c(of(ours["camera"])) - [same[1][0, 0], same[1][1, 1], same[1][0, 2], same[1][1, 2]])
    out["same corners, sigma"] = max(np.abs(apart / [errors[k] for k in ("fx", "fy", "cx", "cy")]).max(),
                                     abs(ours["quality"]["rms_px"][0] - same[0]) / ours["quality"]["sigma_px"][0])
    out |= truth_rows(ours, "camera", truth)
    z = z_of_poses(ours, all_poses, images)
    out |= {"truth, z of poses": np.abs(z).max(), "truth, mean z² of poses": (z**2).mean()}
    return out


def failing(found):
    """Return the names of rows above their bounds."""
    return [name for name, value in found.items() if not value <= BOUNDS[name]]


# Errors applied to Sunstone's results.
def half_a_pixel(ours, corners):
    ours["camera"]["opencv_matrix"][0][2] += 0.5


def exchanged_centre(ours, corners):
    m = ours["camera"]["opencv_matrix"]
    m[0][2], m[1][2] = m[1][2], m[0][2]


def exchanged_coefficients(ours, corners):
    k = ours["camera"]["opencv"]
    k[2], k[4] = k[4], k[2]


def transposed(ours, corners):
    ours["quality"]["poses"] = [[-p[0], -p[1], -p[2], *p[3:]] for p in ours["quality"]["poses"]]


def overconfident(ours, corners):
    ours["quality"]["poses_errors"] = (np.array(ours["quality"]["poses_errors"]) / 3).tolist()


def worse_corners(ours, corners):
    rng = np.random.default_rng(3)
    for name in corners:
        corners[name] += rng.normal(size=corners[name].shape) * 0.08
    ours["quality"]["rms_px"][0] = np.hypot(ours["quality"]["rms_px"][0], 0.08 * 2**0.5)


ERRORS = {"cx off by half a pixel": half_a_pixel, "cx and cy exchanged": exchanged_centre, "p1 and k3 exchanged": exchanged_coefficients,
          "rotations transposed": transposed, "errors a third of what they are": overconfident, "corners off by 0.08 pixels": worse_corners}


def one_lens(count, seed, folder, checked, planted):
    """Render, calibrate and compare; return true if a check fails."""
    folder.mkdir()
    rng = np.random.default_rng(seed + count)
    truth = camera(count)
    all_poses = poses(truth, VIEWS, rng)
    images = photographs(truth, all_poses, folder)
    ours, corners = calibrated(folder, images, count)
    found = theirs(folder, images)
    each = [opencv(way, count) for way in found]
    own, same = min(each, key=lambda result: result[0]), opencv(corners, count)
    failed = False
    if checked:
        print(f"{count} coefficients: RMS of Sunstone {ours['quality']['rms_px'][0]:.4f} pixels in {len(corners)} of {VIEWS} "
              f"images, of OpenCV {each[0][0]:.4f} in {len(found[0])} (cornerSubPix) and {each[1][0]:.4f} in {len(found[1])} (SB), "
              f"and {same[0]:.4f} with Sunstone's corners")
        failed = len(corners) < VIEWS
        for name, value in rows(ours, corners, own, same, truth, all_poses, images).items():
            failed |= not value <= BOUNDS[name]
            print(f"    {name:32} {value:10.4f} {BOUNDS[name]:8.2f}", flush=True)
    if not planted:
        return failed
    for error, change in ERRORS.items():
        if count == 8 and change is exchanged_coefficients:
            continue
        spoilt, worse = json.loads(json.dumps(ours)), {n: c.copy() for n, c in corners.items()}
        change(spoilt, worse)
        noticed = failing(rows(spoilt, worse, own, same, truth, all_poses, images))
        failed |= not noticed
        print(f"{count} coefficients, {error:32} {'detected: ' + '; '.join(noticed) if noticed else 'NOT DETECTED'}")
    spoilt, worse = calibrated(folder, images, count, SQUARE * 1.01)
    noticed = failing(rows(spoilt, worse, own, same, truth, all_poses, images))
    failed |= not noticed
    print(f"{count} coefficients, {'squares of 25.25 mm':32} {'detected: ' + '; '.join(noticed) if noticed else 'NOT DETECTED'}", flush=True)
    return failed


def with_projector(seed, folder, checked, planted):
    """Run the same checks for camera and projector."""
    folder.mkdir()
    rng = np.random.default_rng(seed + 99)
    eye, lamp = camera(5), projector()
    all_poses = poses(eye, PROJECTOR_VIEWS, rng, lamp)
    run("calibrate", "patterns", "--projector", f"{PROJECTOR[0]}x{PROJECTOR[1]}", "-o", "patterns", folder=folder)
    names = sorted(p.name for p in (folder / "patterns").iterdir())

    def one(i):
        tables = eye.table("camera", all_poses[i]) + lamp.table("projector", after(BETWEEN, all_poses[i]))
        more = "".join(f"[[slices]]\nname = \"p{n[:3]}\"\nprojector = {{ mask = \"patterns/{n}\" }}\npolarization = \"intensity\"\n" for n in names)
        (folder / f"{i}.toml").write_text(scene(tables, f"spp = {PROJECTOR_SPP}\nseed = {i}\n") + more)
        run("render", f"{i}.toml", "-o", f"{i}.zarr", "--no-figures", "--force", "--threads", 1, folder=folder)
        (folder / f"view{i}").mkdir()
        for n in names:
            run("probe", f"{i}.zarr", f"p{n[:3]}", "--sum", "wavelength", "-o", f"view{i}/{n[:3]}.npy", "--force", folder=folder)
        # Other files with the same prefix contain coordinates and standard errors.
        for other in (folder / f"view{i}").iterdir():
            if len(other.name) > len("000.npy"):
                other.unlink()
        return f"view{i}"
    with ThreadPoolExecutor(2) as pool:
        views = list(pool.map(one, range(len(all_poses))))
    run("calibrate", "projector", *views, "--columns", COLUMNS, "--rows", ROWS, "--square", f"{SQUARE * 1000}mm", "--projector",
        f"{PROJECTOR[0]}x{PROJECTOR[1]}", "-o", "pair.toml", folder=folder)
    ours = tomllib.loads((folder / "pair.toml").read_text())

    def compared(found):
        out = {f"camera: {k}": v for k, v in truth_rows(found, "camera", eye).items()}
        out |= {f"projector: {k}": v for k, v in truth_rows(found, "projector", lamp).items()}
        pose = found["projector"]["pose"]["extrinsics"]
        turn = cv2.Rodrigues(np.array(pose["R"]) @ cv2.Rodrigues(BETWEEN[0])[0].T)[0].ravel()
        z = np.array([*turn, *(np.array(pose["t"]) - BETWEEN[1])]) / found["quality"]["pose_errors"]
        out["projector: truth, z of poses"] = np.abs(z).max()
        # All parameters of both devices together, which also detects deviations against their correlations.
        off = np.concatenate([*[[*f_and_c(d) - f_and_c(t), *(d.lens - t.lens)] for d, t in
                                ((of(found["camera"]), eye), (of(found["projector"]), lamp))], turn, np.array(pose["t"]) - BETWEEN[1]])
        covariance = np.array(found["covariance"]["rows"])
        scale = np.sqrt(np.diag(covariance))
        out["pair: truth, mean z² of all"] = (off / scale) @ np.linalg.solve(covariance / np.outer(scale, scale), off / scale) / off.size
        return out

    failed = False
    bound = lambda name: BOUNDS[name.split(": ")[1]]
    if checked:
        q = ours["quality"]
        failed = q["views"] < PROJECTOR_VIEWS
        print(f"camera and projector: RMS {q['rms_px'][0]:.4f} and {q['rms_px'][1]:.4f} pixels in {q['views']} of {PROJECTOR_VIEWS} views; "
              f"projector fx ± {q['projector_errors']['fx']:.3f}, place ± {1e3 * max(q['pose_errors'][3:]):.3f} mm")
        for name, value in compared(ours).items():
            failed |= not value <= bound(name)
            print(f"    {name:36} {value:6.4f} {bound(name):8.2f}", flush=True)
    if not planted:
        return failed

    def half(found):
        found["projector"]["opencv_matrix"][1][2] += 0.5

    def turned(found):
        found["projector"]["pose"]["extrinsics"]["R"] = np.array(found["projector"]["pose"]["extrinsics"]["R"]).T.tolist()

    for error, change in {"cy of the projector off by half a pixel": half, "R transposed": turned}.items():
        spoilt = json.loads(json.dumps(ours))
        change(spoilt)
        noticed = [name for name, value in compared(spoilt).items() if not value <= bound(name)]
        failed |= not noticed
        print(f"projector, {error:40} {'detected: ' + '; '.join(noticed) if noticed else 'NOT DETECTED'}", flush=True)
    return failed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    parser.add_argument("--both", action="store_true", help="compare, and check that planted errors are detected")
    parser.add_argument("--seed", type=int, default=1, help="of poses")
    a = parser.parse_args()
    failed, checked, planted = False, a.both or not a.power, a.both or a.power
    with tempfile.TemporaryDirectory() as folder:
        if checked:
            print(f"{'':36} {'found':>10} {'bound':>8}")
        for count in LENSES:
            failed |= one_lens(count, a.seed, Path(folder) / f"lens{count}", checked, planted)
        failed |= with_projector(a.seed, Path(folder) / "projector", checked, planted)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
