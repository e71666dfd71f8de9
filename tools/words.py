#!/usr/bin/env python3
"""Refuse words that the project does not use: metaphors, and phrases that depend on word order. Exit with 1 if one is found.

Each pattern is followed by the word to use instead. Patterns match whole words in all tracked sources and pages, in any case.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SUFFIXES = {".rs", ".py", ".pyi", ".md", ".toml"}
WORDS = {
    "told": "reported, printed, given",
    "mend(?:s|ed|ing)?": "fix",
    "goes on|go on|went on": "resumes, continues",
    "so many": "N, this number of",
    "by chance": "at random",
    "alike": "equal, the same",
    "at rest": "(write a sentence)",
    "house": "workspace",
    "front door": "public API",
    "lumber": "(delete)",
    "surer": "more reliable",
    "hangs? on": "depends on",
    "hardly": "barely",
    "beside each other": "concurrently; next to each other",
    "who wants": "to ..., use ...",
    "for want of": "because ... is missing",
}
PATTERN = re.compile(rf"\b(?:{'|'.join(f'({word})' for word in WORDS)})\b")
FIXES = list(WORDS.values())


def main():
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
    found = 0
    for name in files:
        path = ROOT / name
        if path.suffix not in SUFFIXES or path == Path(__file__).resolve() or not path.exists():
            continue
        text = path.read_text().lower()
        for match in PATTERN.finditer(text):
            fix = next(f for f, group in zip(FIXES, match.groups()) if group)
            line = text.count("\n", 0, match.start()) + 1
            print(f"{name}:{line}: {match.group()!r}: write {fix}")
            found += 1
    if found:
        sys.exit(f"{found} words to replace")


if __name__ == "__main__":
    main()
