#!/usr/bin/env python3
"""Check chessboard images in every file format that cameras write, against OpenCV on the same files.

Six poses of a board are drawn and written as PNG with 8 and 16 bits and with alpha, and as JPEG: grey, colour with subsampling,
progressive, CMYK, and each EXIF orientation. `sunstone calibrate board` finds corners in the files, as does OpenCV
(`findChessboardCornersSB` on the result of `cv2.imread`, which rotates by EXIF). The table lists the root mean square distance of
Sunstone's corners from OpenCV's and from the truth, the error of the focal lengths over their standard error, and whether the
calibrated resolution is that of OpenCV's image. Files that must be refused are a JPEG truncated at ten places, one of another
orientation among the others, and a JPEG named .png. Exits with 1 if a row is above its bound or an invalid file is accepted.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import cv2
    import numpy as np
    from PIL import Image

COLUMNS, ROWS, SQUARE = 9, 6, 0.025
SIZE, FOCAL = (640, 480), 560.0
# Largest root mean square distance from OpenCV's corners and from the truth, pixels, and largest z-score of a focal length.
CORNERS, TRUTH, SIGMA = 0.06, 0.06, 5
FINE = 4


def board(pose):
    """Return an image of the board, with values from 0 to 1 and FINE by FINE samples per pixel."""
    turn, at = cv2.Rodrigues(np.array(pose[:3]))[0], np.array(pose[3:])
    v, u = np.mgrid[0 : SIZE[1] * FINE, 0 : SIZE[0] * FINE]
    rays = np.stack([((u + 0.5) / FINE - SIZE[0] / 2) / FOCAL, ((v + 0.5) / FINE - SIZE[1] / 2) / FOCAL, np.ones(u.shape)], axis=-1)
    normal = turn[:, 2]
    points = rays * ((normal @ at) / (rays @ normal))[..., None]
    local = (points - at) @ turn / SQUARE
    x, y = np.floor(local[..., 0]) + 1, np.floor(local[..., 1]) + 1
    inside = (x >= 0) & (x <= COLUMNS) & (y >= 0) & (y <= ROWS)
    grey = np.where(inside & ((x + y) % 2 == 0), 0.1, 0.85)
    return grey.reshape(SIZE[1], FINE, SIZE[0], FINE).mean(axis=(1, 3))


def poses():
    centre = np.array([(COLUMNS - 1) / 2, (ROWS - 1) / 2, 0]) * SQUARE
    found = []
    for i in range(6):
        turn = np.array([0.5 * np.cos(1.1 * i), 0.5 * np.sin(1.1 * i), 0.1])
        middle = np.array([0.02 * np.cos(2 * i), 0.015 * np.sin(i), 0.36 + 0.02 * (i % 3)])
        found.append([*turn, *(middle - cv2.Rodrigues(turn)[0] @ centre)])
    return found


def stored(image, orientation):
    """Return the pixels that a file with an EXIF orientation stores for an image."""
    back = {1: lambda a: a, 2: lambda a: a[:, ::-1], 3: lambda a: a[::-1, ::-1], 4: lambda a: a[::-1], 5: lambda a: a.transpose(1, 0, 2),
            6: lambda a: np.rot90(a), 7: lambda a: np.rot90(a.transpose(1, 0, 2), 2), 8: lambda a: np.rot90(a, -1)}
    return np.ascontiguousarray(back[orientation](image))


def write(kind, image, path):
    """Write one image, with values from 0 to 1, as a file of a kind."""
    grey = (image * 255).round().astype(np.uint8)
    colour = np.stack([grey, (grey * 0.9).astype(np.uint8), (grey * 0.8).astype(np.uint8)], axis=-1)
    if kind == "png, 16 bits":
        cv2.imwrite(str(path), (image * 65535).round().astype(np.uint16))
    elif kind == "png, opacity":
        Image.fromarray(np.dstack([colour, np.full_like(grey, 77)])).save(path)
    elif kind in ("png", "jpg, grey"):
        Image.fromarray(grey).save(path, **({} if kind == "png" else {"quality": 95}))
    elif kind == "jpg, CMYK":
        Image.fromarray(colour).convert("CMYK").save(path, quality=95)
    else:
        orientation = int(kind.split()[-1]) if "orientation" in kind else 1
        exif = Image.Exif()
        exif[0x0112] = orientation
        Image.fromarray(stored(colour, orientation)).save(path, quality=92, subsampling=2, progressive="progressive" in kind, exif=exif)


def run(folder, names):
    """Return Sunstone's calibration, its corners by image in OpenCV's pixel coordinates, and the output; None if refused."""
    words = ["calibrate", "board", *names, "--columns", COLUMNS, "--rows", ROWS, "--square", "25mm", "--lens", "none", "-o", "c.toml",
             "--corners", "corners.csv"]
    (folder / "c.toml").unlink(missing_ok=True)
    done = subprocess.run([environment.sunstone(), *map(str, words)], cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        return None, done.stderr
    corners = {}
    for row in list(csv.reader(open(folder / "corners.csv")))[1:]:
        corners.setdefault(row[0], []).append([float(row[4]) - 0.5, float(row[5]) - 0.5])
    return (tomllib.loads((folder / "c.toml").read_text()), {n: np.array(c) for n, c in corners.items()}), done.stderr


def compare(kind, images, folder):
    """Return distances of corners from OpenCV's and from the truth, z-score of focal lengths, and whether the resolution is
    OpenCV's.
    """
    names = [f"{i}.{kind[:3]}" for i in range(len(images))]
    for name, image in zip(names, images):
        write(kind, image, folder / name)
    ours, said = run(folder, names)
    if ours is None:
        print(said)
        return np.inf, np.inf, np.inf, False
    calibration, corners = ours
    points = np.array([[i % COLUMNS * SQUARE, i // COLUMNS * SQUARE, 0] for i in range(COLUMNS * ROWS)])
    matrix = np.array([[FOCAL, 0, SIZE[0] / 2 - 0.5], [0, FOCAL, SIZE[1] / 2 - 0.5], [0, 0, 1]])
    off, wrong = [], []
    for name, pose in zip(names, poses()):
        image = cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        found, there = cv2.findChessboardCornersSB(image, (COLUMNS, ROWS), flags=cv2.CALIB_CB_ACCURACY)
        if not found or name not in corners:
            return np.inf, np.inf, np.inf, False
        truth = cv2.projectPoints(points, np.array(pose[:3]), np.array(pose[3:]), matrix, None)[0].reshape(-1, 2)
        # OpenCV may start at the opposite end of the board.
        there = min((there.reshape(-1, 2), there.reshape(-1, 2)[::-1]), key=lambda t: np.abs(corners[name] - t).max())
        off.append(corners[name] - there)
        wrong.append(corners[name] - truth)
    spread = [np.sqrt((np.concatenate(d) ** 2).sum(axis=1).mean()) for d in (off, wrong)]
    errors, found = calibration["quality"]["camera_errors"], np.array(calibration["camera"]["opencv_matrix"])
    z = max(abs(found[0, 0] - FOCAL) / errors["fx"], abs(found[1, 1] - FOCAL) / errors["fy"])
    return *spread, z, tuple(calibration["camera"]["resolution"]) == image.shape[::-1]


def refusals(images, folder):
    """Return files that must be refused: their kind, their number, and the number refused."""
    names = [f"{i}.jpg" for i in range(len(images))]
    for name, image in zip(names, images):
        write("jpg", image, folder / name)
    whole = (folder / names[0]).read_bytes()
    refused = 0
    for k in range(10):
        (folder / names[0]).write_bytes(whole[: len(whole) * (k + 1) // 11])
        refused += run(folder, names)[0] is None
    yield "a JPEG cut off", 10, refused
    write("jpg, orientation 3", images[0], folder / names[0])
    yield "another orientation among them", 1, int(run(folder, names)[0] is None)
    (folder / "jpeg.png").write_bytes(whole)
    yield "a JPEG named .png", 1, int(run(folder, ["jpeg.png", *names[1:]])[0] is None)


def main():
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    images = [board(pose) for pose in poses()]
    kinds = ["png", "png, 16 bits", "png, opacity", "jpg, grey", "jpg, colour", "jpg, progressive", "jpg, CMYK"]
    kinds += [f"jpg, orientation {o}" for o in range(1, 9)]
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        print(f"{'':32} {'OpenCV, px':>11} {'truth, px':>10} {'focal, z':>9}  resolution")
        for kind in kinds:
            off, wrong, z, same = compare(kind, images, folder)
            good = off <= CORNERS and wrong <= TRUTH and z <= SIGMA and same
            failed |= not good
            print(f"{kind:32} {off:11.4f} {wrong:10.4f} {z:9.2f}  {'as OpenCV' if same else 'DIFFERENT'}{'' if good else '  WRONG'}",
                  flush=True)
        for what, planted, refused in refusals(images, folder):
            failed |= refused < planted
            print(f"{what:32} {refused} of {planted} refused")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
