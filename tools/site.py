"""Hooks of mkdocs.yml: pages link to files outside docs/, which the site has as well.

A link that leaves docs/ (`../CONVENTIONS.md`, `../../scenes/fruits/variants.toml`) is followed: Markdown becomes a page of the site,
a picture or a data file a copy, a text of the program or of a scene a page that shows it, and a folder a page that lists its
files. They stand under repository/, by their paths there. The pages of the Rust library are what `cargo doc` made, under rust/.
"""

import os
import re
import shutil
from pathlib import Path, PurePosixPath

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s#]+)(#[^)\s]*)?(\))")
# Its pages come when the site is built (`on_post_build`), so that the link is none that is checked.
RUST = """# Rust: reference

What `cargo doc` makes of the sources: <a href="rust/sunstone/index.html">the crate sunstone and all that is behind it</a>.
[Using the library](library.md) says how to begin.
"""
FENCE = re.compile(r"^(```|~~~)")
# Texts that a page shows, by what its highlighter calls their language.
LANGUAGES = {".rs": "rust", ".toml": "toml", ".py": "python", ".sh": "bash", ".json": "json"}


def leaves(source, link):
    """Where a link of a file of the repository leads, from its root; None if elsewhere than to a file."""
    if re.match(r"[a-z]+:", link) or link.startswith("/"):
        return None
    target = (source.parent / link).resolve()
    if not target.is_relative_to(ROOT):
        raise PluginError(f"{source.relative_to(ROOT)}: {link} leaves the repository")
    if not target.exists():
        raise PluginError(f"{source.relative_to(ROOT)}: there is no {link}")
    return target.relative_to(ROOT)


def uri(path):
    """The place in the site of a file of the repository."""
    path = PurePosixPath(path)
    if path.parts and path.parts[0] == "docs":
        return str(PurePosixPath(*path.parts[1:]))
    place = PurePosixPath("repository") / path
    if (ROOT / path).is_dir():
        return str(place / "folder.md")
    return f"{place}.md" if place.suffix in LANGUAGES else str(place)


def blocks(text):
    """The parts of a page in turn, and whether each is outside fenced code. (A link's text may go over a line's end.)"""
    inside, block = False, ""
    for line in text.splitlines(keepends=True):
        if not FENCE.match(line.lstrip()):
            block += line
        elif inside:
            yield block + line, False
            inside, block = False, ""
        else:
            yield block, True
            inside, block = True, line
    yield block, not inside


def links(text):
    """All links of a page."""
    return [match[2] for block, outside in blocks(text) if outside for match in LINK.finditer(block)]


def shown(path):
    """The page of a file or folder that is no page by itself, or None."""
    full = ROOT / path
    if full.is_dir():
        names = sorted(p.name for p in full.iterdir() if p.is_file() and not p.name.startswith("."))
        return f"# {path}/\n\n" + "".join(f"- [{name}]({name})\n" for name in names)
    if full.suffix in LANGUAGES:
        # Longer than any fence within.
        return f"# {path}\n\n`````{LANGUAGES[full.suffix]}\n{full.read_text()}\n`````\n"
    return None


def on_files(files, config):
    """Adds what pages link to outside docs/, and what those link to, as far as it goes."""
    waiting = [ROOT / "docs" / f.src_uri for f in files if f.src_uri.endswith(".md")]
    # The front page is README's.
    waiting.append(ROOT / "README.md")
    known = set(waiting)
    while waiting:
        source = waiting.pop()
        text = shown(source.relative_to(ROOT)) or (source.read_text() if source.suffix == ".md" else "")
        base = source / "folder.md" if source.is_dir() else source
        for link in links(text) if source.suffix == ".md" or source.is_dir() else []:
            target = leaves(base, link)
            if target is None or target.parts[:1] == ("docs",) or ROOT / target in known:
                continue
            full = ROOT / target
            known.add(full)
            waiting.append(full)
            page = shown(target)
            if page is None:
                files.append(File.generated(config, uri(target), abs_src_path=str(full)))
            else:
                files.append(File.generated(config, uri(target), content=page))
    files.append(File.generated(config, "rust-reference.md", content=RUST))
    files.append(File.generated(config, "index.md", content=(ROOT / "README.md").read_text()))
    return files


def on_page_markdown(markdown, page, config, files):
    """Turns a page's links into those of the site."""
    place = page.file.src_uri
    if place == "rust-reference.md":
        return markdown
    if place == "index.md":
        source = ROOT / "README.md"
    elif place.startswith("repository/"):
        source = ROOT / place.removeprefix("repository/")
        if place.endswith("/folder.md"):
            source = source.parent / "folder.md"
        elif not source.exists():
            # A text that is shown has no links.
            return markdown
    else:
        source = ROOT / "docs" / place
    here = PurePosixPath(place).parent

    def turned(match):
        target = leaves(source, match[2])
        if target is None:
            return match[0]
        to = PurePosixPath(uri(target)) if target != PurePosixPath("README.md") else PurePosixPath("index.md")
        link = os.path.relpath(to, here)
        return match[1] + link + (match[3] or "") + match[4]

    return "".join(LINK.sub(turned, block) if outside else block for block, outside in blocks(markdown))


def on_post_build(config):
    """Brings the pages of the Rust library in."""
    made = ROOT / "target/doc"
    if not (made / "sunstone/index.html").is_file():
        raise PluginError("there are no pages of the Rust library in target/doc: run `cargo doc --no-deps --workspace` first")
    shutil.copytree(made, Path(config["site_dir"]) / "rust", dirs_exist_ok=True)
