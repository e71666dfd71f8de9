#!/usr/bin/env python3
"""Print the number of lines of Rust in every crate: code, tests and doc comments separately, without blank lines.

Tests are files in `tests/` folders, files declared by `#[cfg(test)] mod NAME;`, and `#[cfg(test)] mod` blocks, which must end
their files. With --write, the columns in ARCHITECTURE.md are replaced.
"""

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "ARCHITECTURE.md"


def tracked():
    """Return all tracked Rust files."""
    names = subprocess.run(["git", "ls-files", "*.rs"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [Path(name) for name in names.splitlines()]


def test_files(files):
    """Return files and folders that are compiled only for tests."""
    found = set()
    for file in files:
        text = (ROOT / file).read_text()
        folder = file.parent if file.name in ("mod.rs", "lib.rs", "main.rs") else file.with_suffix("")
        for name in re.findall(r"#\[cfg\((?:all\()?test\b[^\]]*\]\s*(?:#\[[^\]]*\]\s*)*mod (\w+);", text):
            found |= {folder / f"{name}.rs", folder / name}
    return found


def crate(file):
    """Return the crate of a file: a package in src/, or the top-level folder."""
    first, second = file.parts[:2]
    if first == "src":
        return second if (ROOT / first / second / "Cargo.toml").is_file() else "sunstone"
    return first


def count():
    """Return the number of lines by crate and kind."""
    files = tracked()
    tests = test_files(files)
    lines = {}
    for file in files:
        whole = file.parts[0] == "tests" or file in tests or any(folder in tests for folder in file.parents)
        counts = lines.setdefault(crate(file), Counter())
        is_test = whole
        all_lines = (ROOT / file).read_text().splitlines()
        for line, following in zip(all_lines, [*all_lines[1:], ""], strict=True):
            is_test |= line.startswith("#[cfg(test)]") and following.endswith("{")
            text = line.strip()
            if text:
                counts["docs" if text.startswith(("///", "//!")) else "tests" if is_test else "code"] += 1
            counts["lines"] += 1
    return lines


def main():
    lines = count()
    row = "{:14} {:>8} {:>8} {:>8} {:>8}"
    print(row.format("crate", "code", "tests", "docs", "lines"))
    for name, c in sorted(lines.items(), key=lambda item: -item[1]["lines"]):
        print(row.format(name, c["code"], c["tests"], c["docs"], c["lines"]))
    total = sum(lines.values(), Counter())
    print(row.format("all", total["code"], total["tests"], total["docs"], total["lines"]))
    if "--write" in sys.argv[1:]:
        def cell(match):
            counts = lines[match[1]]
            return f"| `{match[1]}` | {counts['code']:,} | {counts['tests']:,} |"
        text, n = re.subn(r"\| `(\w+)` \| [\d,]+ \| [\d,]+ \|", cell, PAGE.read_text())
        PAGE.write_text(text)
        print(f"{n} rows of {PAGE.name}")


if __name__ == "__main__":
    main()
