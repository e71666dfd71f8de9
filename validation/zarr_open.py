#!/usr/bin/env python3
"""Opens a store that Sunstone wrote with xarray, as any user would, and checks that it explains itself.

usage: zarr_open.py STORE [GROUP]

Every group must open without warnings, with named dimensions, a coordinate for each, and units everywhere; one group
(the first, or GROUP) is printed. Exit code 0 if so. Needs xarray and zarr: see requirements.txt, or use .venv/bin/python.
"""

import sys
import warnings

import numpy as np
import xarray
import zarr


def check(store, group):
    """Opens a group and asserts that its arrays are labelled."""
    data = xarray.open_dataset(store, group=group, engine="zarr", consolidated=False)
    for name in ("mean", "std_error"):
        assert name in data, f"{group} has no {name}"
    for name, array in data.data_vars.items():
        assert array.attrs.get("units"), f"{group}/{name} has no units"
        for dimension in array.dims:
            assert not dimension.startswith("dim_"), f"{group}/{name} has an unnamed dimension"
            assert dimension in data.coords, f"{group}/{name} has no coordinate along {dimension}"
    for name, coordinate in data.coords.items():
        assert coordinate.attrs.get("units"), f"{group}/{name} has no units"
        steps = np.diff(coordinate.values)
        assert (steps > 0).all(), f"{group}/{name} does not rise"
    assert data["mean"].shape == data["std_error"].shape
    assert (data["std_error"].fillna(0) >= 0).all(), f"{group} has negative standard errors"
    return data


def main(store, shown=None):
    warnings.simplefilter("error")
    # Slices are the groups that hold a mean (nested groups too, were there any).
    root = zarr.open_group(store, mode="r")
    groups = sorted(name for name, _ in root.groups())
    assert groups, f"{store} has no groups"
    opened = {group: check(store, group) for group in groups}
    for group, data in opened.items():
        sizes = ", ".join(f"{k} {v}" for k, v in data["mean"].sizes.items())
        print(f"{group:20} {sizes}")
    print()
    print(opened[shown or groups[0]])
    print(f"\n{len(groups)} groups open cleanly (xarray {xarray.__version__}, zarr {zarr.__version__})")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    main(*sys.argv[1:])
