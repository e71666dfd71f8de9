"""What both programs made of one scene: images beside each other, as they are compared, stored and falsified."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import comparison
from frames import rotate


@dataclass
class Pair:
    """Images [y, x, (t,) element] of one scene.

    `ours` and `ours_error` are Sunstone's mean and standard error. `theirs` has Mitsuba's renders of independent seeds
    first. `angle` [y, x] turns their Stokes frames into ours (None: the frames are the same). `block`: squares of so
    many pixels are averaged before comparing, because errors are not Gaussian where few strong paths reach a pixel.
    `wrong` holds mistaken versions of `ours` for the power check, by the name of the mistake. `our_batches`: seeds
    that our error was estimated from, if not from all single samples.
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
        """Whether there is an axis of time."""
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
        """Their images in our frames."""
        if self.angle is None:
            return self.theirs
        return rotate(self.theirs, self.angle[..., None] if self.timed else self.angle)

    def images(self, mistake=None):
        """Ours, our error, theirs, their error; our side falsified by a mistake of `MISTAKES`. None: it has no room
        here."""
        ours = self.ours if mistake is None else MISTAKES[mistake](self)
        if ours is None:
            return None
        theirs = self.theirs if mistake == "frame" else self.turned()
        theirs, theirs_error = comparison.mean_and_error(self._blocks(theirs))
        error = np.sqrt(self._blocks(self.ours_error**2)) / self.block
        return self._blocks(ours), error, theirs, theirs_error

    def _blocks(self, images):
        """Means over squares of pixels of [..., y, x, (t,) element]."""
        tail = images.shape[-2:] if self.timed else images.shape[-1:]
        *seeds, h, w = images.shape[: -len(tail)]
        n = self.block
        return images.reshape(*seeds, h // n, n, w // n, n, *tail).mean(axis=(-3 - len(tail), -1 - len(tail)))

    def compare(self, mistake=None):
        """Rows: scene, quantity, outcome; None if the mistake has no room here."""
        images = self.images(mistake)
        if images is None:
            return None
        scale = np.abs(images[2]).max()
        rows = []
        for i, element in enumerate(self.elements):
            one = [image[..., i] for image in images]
            outcome = comparison.compare(*one, len(self.theirs), scale, self.our_batches)
            rows.append((self.scene, f"{element} {self.what}".strip(), outcome))
        return rows


# Mistakes to be found by the power check, as changes of our image ----------------------------------------------------


def flip(pair, i):
    """The sign of a Stokes element, or of a row of the matrix."""
    rows = np.arange(len(pair.elements)) * 4 // len(pair.elements)
    return pair.ours * np.where(rows == i, -1.0, 1.0)


def column(pair):
    """The sign of the matrix's last column."""
    if len(pair.elements) == 16:
        return pair.ours * np.where(np.arange(16) % 4 == 3, -1.0, 1.0)
    return pair.wrong.get("column")


MISTAKES = {
    "s1": lambda pair: flip(pair, 1),
    "s2": lambda pair: flip(pair, 2),
    "s3": lambda pair: flip(pair, 3),
    "intensity": lambda pair: 1.01 * pair.ours,
    "frame": lambda pair: None if pair.angle is None else pair.ours,
    "column": column,
    "wavelength": lambda pair: pair.wrong.get("wavelength"),
    "bin": lambda pair: np.roll(pair.ours, 1, axis=2) if pair.timed else None,
}


def load_all(folder: Path):
    """The last run's results, in the order of that run."""
    listing = folder / "pairs.txt"
    return [Pair.load(folder / f"{name}.npz") for name in listing.read_text().split()] if listing.exists() else []


def compare_all(results, mistake=None):
    """Rows of the table: scene, quantity, outcome; of the pairs in which a mistake can be planted, if one is."""
    return [row for pair in results for row in pair.compare(mistake) or []]


def verdicts(rows, total=None):
    """Whether each row passes, at SIGNIFICANCE over all rows (or `total`) together."""
    limit = comparison.SIGNIFICANCE / (total or len(rows))
    return [row.p >= limit for *_, row in rows]
