"""Hooks of mkdocs.yml: the site includes files outside docs/ that pages link to.

Links that leave docs/ (`../CONVENTIONS.md`, `../../scenes/fruits/variants.toml`) are followed. A Markdown file becomes a page of
the site. An image or a data file is copied. Source code and scene files become pages that show them, and a folder becomes a page
that lists its files. All these pages are under repository/, by their paths in the repository. The pages of the Rust library come
from `cargo doc`, under rust/.
"""

import os
import re
import shutil
from importlib.util import find_spec
from pathlib import Path, PurePosixPath

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s#]+)(#[^)\s]*)?(\))")
# The linked pages are added after the build (`on_post_build`); the HTML link avoids mkdocs' check.
RUST = """# Rust: reference

API documentation from `cargo doc`: <a href="rust/sunstone/index.html">the crate sunstone and its dependencies</a>.
To get started, see [Using the library](library.md).
"""
FENCE = re.compile(r"^(```|~~~)")
# Texts that a page shows, with the highlighter's name of their language.
LANGUAGES = {".rs": "rust", ".toml": "toml", ".py": "python", ".sh": "bash", ".json": "json"}


def leaves(source, link):
    """Return the target of a link in a repository file, relative to the root; None for URLs and absolute paths."""
    if re.match(r"[a-z]+:", link) or link.startswith("/"):
        return None
    target = (source.parent / link).resolve()
    if not target.is_relative_to(ROOT):
        raise PluginError(f"{source.relative_to(ROOT)}: the link {link} leaves the repository; link to its URL")
    if not target.exists():
        raise PluginError(f"{source.relative_to(ROOT)}: the link {link} leads to no file; correct the link")
    return target.relative_to(ROOT)


def uri(path):
    """Return the site's path of a file of the repository."""
    path = PurePosixPath(path)
    if path.parts and path.parts[0] == "docs":
        return str(PurePosixPath(*path.parts[1:]))
    place = PurePosixPath("repository") / path
    if (ROOT / path).is_dir():
        return str(place / "folder.md")
    return f"{place}.md" if place.suffix in LANGUAGES else str(place)


def blocks(text):
    """Yield the parts of a page in order, each with a flag: outside fenced code or not. (Link texts may span lines.)"""
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
    """Return all links of a page."""
    return [match[2] for block, outside in blocks(text) if outside for match in LINK.finditer(block)]


def shown(path):
    """Return the page that shows a file or folder, or None if the file is a page or a data file."""
    full = ROOT / path
    if full.is_dir():
        names = sorted(p.name for p in full.iterdir() if p.is_file() and not p.name.startswith("."))
        return f"# {path}/\n\n" + "".join(f"- [{name}]({name})\n" for name in names)
    if full.suffix in LANGUAGES:
        # This fence is longer than any fence in the file.
        return f"# {path}\n\n`````{LANGUAGES[full.suffix]}\n{full.read_text()}\n`````\n"
    return None


def on_files(files, config):
    """Add files outside docs/ that pages link to, and recursively the files that those link to."""
    waiting = [ROOT / "docs" / f.src_uri for f in files if f.src_uri.endswith(".md")]
    # The front page is README.md.
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
    """Rewrite a page's links to paths of the site."""
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
            # Source text contains no links.
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


RUST_PAGES = ROOT / "target/doc"
# The site runs the tutorials, which import these packages.
PACKAGES = ["pysunstone", "xarray", "zarr", "matplotlib", "distributed", "ipykernel"]


def on_startup(command, dirty):
    """Check everything that the site needs before the build, which takes minutes."""
    needed = [f"the package {name}: pip install './python[docs]'" for name in PACKAGES if find_spec(name) is None]
    if not (RUST_PAGES / "sunstone/index.html").is_file():
        needed.append("the pages of the Rust library in target/doc: cargo doc --no-deps --workspace")
    if not (ROOT / "target/release/sunstone").is_file() and shutil.which("sunstone") is None:
        needed.append("the command sunstone, which tutorials run: cargo build --release")
    if needed:
        raise PluginError("the site needs, before `mkdocs build`:\n" + "\n".join(f"  {one}" for one in needed))


def on_post_build(config):
    """Add the pages of the Rust library."""
    shutil.copytree(RUST_PAGES, Path(config["site_dir"]) / "rust", dirs_exist_ok=True)
