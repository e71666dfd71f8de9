"""The package extras that the documentation names exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def reported() -> dict[str, set[str]]:
    """Return the extras that documentation pages name with the package, by file."""
    pages = [ROOT / "README.md", ROOT / "mkdocs.yml", *(ROOT / "docs").rglob("*.md"), *(ROOT / "validation").glob("*.py")]
    found = {page.name: re.findall(r"\./python\[([\w,]+)\]", page.read_text()) for page in pages}
    return {name: {extra for words in all for extra in words.split(",")} for name, all in found.items() if all}


def test_extras_named_in_pages_exist() -> None:
    project = (ROOT / "python/pyproject.toml").read_text()
    section = project.split("[project.optional-dependencies]")[1].split("\n[")[0]
    there = set(re.findall(r"(?m)^(\w+) = \[", section))
    named = reported()
    assert "README.md" in named and len(there) >= 5
    wrong = {page: extras - there for page, extras in named.items() if extras - there}
    assert not wrong, wrong
