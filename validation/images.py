"""Draw images of a comparison: Sunstone, the reference, the difference in units of its error, and the p-value of each pixel.

One sheet per pair; every Stokes or Mueller element is a row. s0 and T00 are grey; all others range from blue (negative) over
white to red. Time-resolved light is shown as an x-t slice through the middle row, time upward. Differences and p-values are those
of the compared squares of pixels.
"""

import math

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import comparison

PANEL, GAP, LABEL, HEAD = 96, 4, 64, 34
COLUMNS = ["Sunstone", "Mitsuba", "difference / error", "p-value"]
# Colour scales end at this number of standard errors and at this p-value.
MAX_Z, MIN_P = 4.0, 1e-4
BLUE, WHITE, RED = np.array([33, 102, 172]), np.array([247, 247, 247]), np.array([178, 24, 43])


def diverging(values):
    """Map [-1, 1] to blue, white, red."""
    v = np.clip(values, -1, 1)[..., None]
    return np.where(v < 0, WHITE + (BLUE - WHITE) * -v, WHITE + (RED - WHITE) * v)


def grey(values):
    """Map [0, 1] to black and white, sRGB-encoded."""
    return 255 * np.sqrt(np.clip(values, 0, 1))[..., None] * np.ones(3)


def p_colour(p):
    """Map p to white for 1, black for MIN_P and below."""
    return 255 * (1 - np.clip(np.log10(np.maximum(p, 1e-300)) / math.log10(MIN_P), 0, 1))[..., None] * np.ones(3)


def panel(colours):
    """Return an image PANEL pixels wide, with enlarged pixels."""
    h, w = colours.shape[:2]
    image = Image.fromarray(np.uint8(np.round(colours)))
    return image.resize((PANEL, max(1, round(PANEL * h / w)) if w >= h else PANEL), Image.NEAREST)


def sheet(pair):
    """Return the image of one pair."""
    ours, ours_error, theirs, theirs_error = pair.images()
    scale = np.abs(theirs).max()
    z = comparison.z_scores(ours, ours_error, theirs, theirs_error, len(pair.theirs), scale, pair.our_batches)[0]
    p = np.vectorize(comparison.two_sided)(z)
    cut = (lambda a: a[a.shape[0] // 2].swapaxes(0, 1)[::-1]) if pair.timed else (lambda a: a)
    full = cut(pair.ours), cut(pair.turned().mean(0))
    rows = []
    for i, element in enumerate(pair.elements):
        a, b = (image[..., i] for image in full)
        # Single bright pixels would darken all others.
        top = max(np.quantile(np.abs(b), 0.98), 1e-6 * scale)
        show = grey if i == 0 else diverging
        difference, chance = diverging(cut(z)[..., i] / MAX_Z), p_colour(cut(p)[..., i])
        rows.append((element, [show(a / top), show(b / top), difference, chance]))
    return compose(pair.title, rows)


def compose(title, rows):
    """Return rows of panels with labels; more than eight rows use two columns."""
    font = ImageFont.load_default(11)
    deep = 8 if len(rows) > 8 else len(rows)
    wide = -(-len(rows) // deep)
    side = LABEL + len(COLUMNS) * (PANEL + GAP)
    canvas = Image.new("RGB", (wide * side, HEAD + deep * (PANEL + GAP)), "white")
    draw = ImageDraw.Draw(canvas)
    draw.text((GAP, 2), title, "black", ImageFont.load_default(13))
    for i, (element, colours) in enumerate(rows):
        x, y = i // deep * side, HEAD + i % deep * (PANEL + GAP)
        draw.text((x + GAP, y + PANEL // 2 - 6), element, "black", font)
        for j, values in enumerate(colours):
            left = x + LABEL + j * (PANEL + GAP)
            if i % deep == 0:
                draw.text((left, HEAD - 16), COLUMNS[j], "black", font)
            canvas.paste(panel(values), (left, y))
    return canvas.quantize(128)


def write(pairs, folder):
    """Write a PNG for each pair."""
    for pair in pairs:
        sheet(pair).save(folder / f"{pair.name}.png", optimize=True)
