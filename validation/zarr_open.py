#!/usr/bin/env python3
"""Open a store that Sunstone wrote with xarray, and check that its metadata are complete.

usage: zarr_open.py STORE [GROUP | --power]

Every group must open without warnings, with named dimensions, a coordinate for each, and units everywhere. The whole store must
open as one tree (xarray.open_datatree), whose metadata equal those of its groups and arrays. One group (the first, or GROUP) is
printed. Exit code 0 if all checks pass. With --power, every group and the tree's metadata are damaged in every way that is
checked, and each fault must be detected. Requires xarray and zarr: see requirements.txt, or use .venv/bin/python.
"""

import json
import pathlib
import shutil
import sys
import tempfile
import warnings

import numpy as np
import xarray
import zarr


def load(store, group):
    """Open a group."""
    return xarray.open_dataset(store, group=group, engine="zarr", consolidated=False)


def check(data, group):
    """Assert that a group has means and errors, units, named dimensions, and increasing coordinates."""
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


def check_tree(store, groups):
    """Assert that the store opens as one tree, and that the root's metadata match all groups and arrays."""
    try:
        with xarray.open_datatree(store, engine="zarr") as tree:
            found = sorted(tree.children)
    except ValueError as e:
        raise AssertionError(f"the store does not open as one tree: {e}") from e
    assert found == groups, f"as a tree it has {found}, not {groups}"
    root = pathlib.Path(store)
    said = json.loads((root / "zarr.json").read_text())["consolidated_metadata"]["metadata"]
    stand = {str(p.parent.relative_to(root)): json.loads(p.read_text()) for p in root.glob("*/**/zarr.json")}
    assert said.keys() == stand.keys(), f"consolidated metadata differ in {sorted(said.keys() ^ stand.keys())}"
    for name, description in stand.items():
        description.pop("consolidated_metadata", None)
        assert {k: v for k, v in said[name].items() if k != "consolidated_metadata"} == description, f"{name} differs"


def spoil_tree(store):
    """Yield faults that the check of the tree must detect: name, and a folder with the store's metadata and that fault."""

    def of_samples(said, stand):
        for description in (said["samples"], stand["samples"]):
            description["dimension_names"] = ["y", "x"]

    def of_group(said, _):
        del said[sorted(said)[0]]

    def of_units(said, _):
        next(d for d in said.values() if d["node_type"] == "array")["attributes"]["units"] = "parsec"

    faults = {
        "samples along the slices' dimensions": of_samples,
        "an array that the root does not list": of_group,
        "metadata that are not true": of_units,
    }
    root = pathlib.Path(store)
    for fault, change in faults.items():
        with tempfile.TemporaryDirectory() as folder:
            copy = pathlib.Path(folder, "store")
            skip = shutil.ignore_patterns("c.*", "manifest.txt")
            shutil.copytree(root, copy, ignore=skip)
            paths = {str(p.parent.relative_to(copy)): p for p in copy.glob("**/zarr.json")}
            stand = {name: json.loads(p.read_text()) for name, p in paths.items()}
            change(stand["."]["consolidated_metadata"]["metadata"], stand)
            for name, p in paths.items():
                p.write_text(json.dumps(stand[name]))
            yield fault, copy


def without_units(data, name):
    """Return the group without the units of one of its arrays."""
    data = data.copy()
    data[name].attrs = {}
    return data


def spoil(data):
    """Yield faults that the check must detect: name, and the group with that fault."""
    some = data["mean"].dims[-1]
    yield "no mean", data.drop_vars("mean")
    yield "no errors", data.drop_vars("std_error")
    yield "negative errors", data.assign(std_error=-1 - data["std_error"].fillna(0))
    yield "a dimension without a name", data.rename({some: "dim_0"})
    yield "errors of another shape", data.assign(std_error=data["std_error"].sum(some, keep_attrs=True))
    for name in data.data_vars:
        yield f"no units of {name}", without_units(data, name)
    for name in data.coords:
        yield f"no units of coordinate {name}", without_units(data, name)
        if name in data["mean"].dims:
            yield f"no coordinate {name}", data.drop_vars(name)
        if data[name].size > 1:
            yield f"{name} falls", data.isel({data[name].dims[0]: slice(None, None, -1)})


def power(store, groups):
    """Exit with an error unless every fault is detected."""
    tried = 0
    for group in groups:
        for fault, data in spoil(load(store, group)):
            tried += 1
            try:
                check(data, group)
            except AssertionError:
                continue
            sys.exit(f"{group}: {fault}: NOT DETECTED")
    for fault, spoilt in spoil_tree(store):
        tried += 1
        try:
            check_tree(spoilt, groups)
        except AssertionError:
            continue
        sys.exit(f"the tree: {fault}: NOT DETECTED")
    print(f"{tried} faults planted in {len(groups)} groups, all detected")
    if not tried:
        sys.exit("the store contains no metadata to damage")


def main(store, shown=None):
    warnings.simplefilter("error")
    # Slices are the groups that contain a mean (including nested groups, if any).
    root = zarr.open_group(store, mode="r")
    groups = sorted(name for name, _ in root.groups())
    assert groups, f"{store} has no groups"
    if shown == "--power":
        return power(store, groups)
    opened = {group: check(load(store, group), group) for group in groups}
    check_tree(store, groups)
    for group, data in opened.items():
        sizes = ", ".join(f"{k} {v}" for k, v in data["mean"].sizes.items())
        print(f"{group:20} {sizes}")
    print()
    print(opened[shown or groups[0]])
    print(f"\n{len(groups)} groups open cleanly, and as one tree (xarray {xarray.__version__}, zarr {zarr.__version__})")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    main(*sys.argv[1:])
