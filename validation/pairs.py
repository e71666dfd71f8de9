"""Images of one scene by both programs, as they are compared and stored; planted.py applies errors to them."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import comparison
from frames import rotate


@dataclass
class Pair:
    """Images [y, x, (t,) element] of one scene.

    `ours` and `ours_error` are Sunstone's mean and standard error. The first axis of `theirs` holds Mitsuba's renders with
    independent seeds. `angle` [y, x] rotates their Stokes frames into Sunstone's (None: the frames are equal). `block`: squares
    of block × block pixels are averaged before comparing, because errors are not Gaussian where few bright paths reach a pixel.
    `wrong` holds wrong versions of `ours` for the power check, by the name of the error. `our_batches`: number of seeds that
    Sunstone's error was estimated from, if not from single samples.
    """

    scene: str
    what: str
    elements: list
    ours: np.ndarray
    ours_error: np.ndarray
    theirs: np.ndarray
    angle: np.ndarray | None = None
    block: int = 1
    our_batches: int | None = None
    wrong: dict = field(default_factory=dict)

    @property
    def title(self):
        return f"{self.scene} {self.what}".strip()

    @property
    def name(self):
        return self.title.replace(",", "").replace(" ", "_")

    @property
    def timed(self):
        """Whether there is a time axis."""
        return self.ours.ndim == 4

    def save(self, folder):
        facts = {k: getattr(self, k) for k in ("scene", "what", "elements", "block", "our_batches")}
        arrays = {"ours": self.ours, "ours_error": self.ours_error, "theirs": self.theirs}
        if self.angle is not None:
            arrays["angle"] = self.angle
        arrays |= {f"wrong_{name}": image for name, image in self.wrong.items()}
        np.savez(folder / f"{self.name}.npz", facts=json.dumps(facts), **{k: np.float32(v) for k, v in arrays.items()})

    @classmethod
    def load(cls, path):
        data = dict(np.load(path))
        facts = json.loads(str(data.pop("facts")))
        data = {k: v.astype(float) for k, v in data.items()}
        wrong = {k.removeprefix("wrong_"): data.pop(k) for k in list(data) if k.startswith("wrong_")}
        return cls(**facts, **data, wrong=wrong)

    # The images to compare -------------------------------------------------------------------------------------------

    def turned(self):
        """Return Mitsuba's images in Sunstone's frames."""
        if self.angle is None:
            return self.theirs
        return rotate(self.theirs, self.angle[..., None] if self.timed else self.angle)

    def images(self):
        """Return Sunstone's image and error, Mitsuba's image and error: means over blocks."""
        theirs, theirs_error = comparison.mean_and_error(self.seeds())
        return self.blocks(self.ours), np.sqrt(self.blocks(self.ours_error**2)) / self.block, theirs, theirs_error

    def seeds(self):
        """Return Mitsuba's renders, each in the form that is compared."""
        return self.blocks(self.turned())

    def blocks(self, images):
        """Return means over squares of pixels of [..., y, x, (t,) element]."""
        tail = images.shape[-2:] if self.timed else images.shape[-1:]
        *seeds, h, w = images.shape[: -len(tail)]
        n = self.block
        return images.reshape(*seeds, h // n, n, w // n, n, *tail).mean(axis=(-3 - len(tail), -1 - len(tail)))

    def compare(self, planted=None):
        """Return rows: scene, quantity, outcome. `planted` is added to the blocks of Sunstone's image."""
        ours, *others = self.images()
        if planted is not None:
            ours = ours + planted
        scale = np.abs(others[1]).max()
        rows = []
        for i, element in enumerate(self.elements):
            one = [image[..., i] for image in (ours, *others)]
            outcome = comparison.compare(*one, len(self.theirs), scale, self.our_batches)
            rows.append((self.scene, f"{element} {self.what}".strip(), outcome))
        return rows


def load_all(folder: Path):
    """Return the last run's results, in the order of that run."""
    listing = folder / "pairs.txt"
    return [Pair.load(folder / f"{name}.npz") for name in listing.read_text().split()] if listing.exists() else []


def compare_all(results):
    """Return the rows of the table: scene, quantity, outcome."""
    return [row for pair in results for row in pair.compare()]


def verdicts(rows, total=None):
    """Return whether each row passes, at SIGNIFICANCE over all rows (or `total`) together."""
    limit = comparison.SIGNIFICANCE / (total or len(rows))
    return [row.p >= limit for *_, row in rows]
