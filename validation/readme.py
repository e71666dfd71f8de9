#!/usr/bin/env python3
"""Check README.md and docs/ against validation/results: every number must be measured by a script or marked as given.

    python3 validation/readme.py --check       fails if pages and results differ (CI)
    python3 validation/readme.py --write       writes the numbers of the results into the pages
    python3 validation/readme.py --self-test   plants errors in a small generated project, each of which must be detected (CI)

validation/numbers.toml lists the numbers of each page: the text around them, with {} for a number, and their sources. A source is
a result file (speed: results/speed.json), the name of the number, median | best | least | greatest | error, Python's format, and
optionally a factor (`*100`, `/60`). `,` separates thousands, `e` prints 5.7·10⁻³. result_file.py describes the files. The source
"given" marks a setting or a definition. --check fails if one of the following is true:

- a printed number differs from the result, rounded as printed; or a result, or a number in it, is missing or has no value;
- a text of the list is not in its page, or is there twice;
- README's prose has a number that is neither listed nor of a kind in ALLOWED; or docs/ has one with a unit in MEASURED;
- the page does not name the script that wrote the result;
- a result was measured on a changed tree, or more than AGE commits ago, counting commits that change code of what it measures;
- a relative link is broken; README does not start with the two commands, or takes longer to read than MINUTES.

Standard library only.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import result_file

# Lines of code. Commits that change only comments do not count: of the 60 commits after which five results were outdated, prose
# alone was 20.
CODE = r"^[[:space:]]*([^/[:space:]]|/[^/])"
# Number of commits that may touch what a result measures before it must be measured again.
AGE = 60
# Result files that no page quotes: other scripts use them, with separate formats.
UNQUOTED = {"bsdf_coverage", "ratios"}
# Longest time to read README, and the reading speed in words per minute.
MINUTES, WORDS_A_MINUTE = 3, 250
COMMANDS = ["cargo run --release -- render scenes/mirror_room/scene.toml", "cargo test --release"]

NUMBER = r"[+−-]?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:·10[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+)?"
SOURCE = re.compile(
    r"(?P<file>\w+):(?P<name>\w+)\.(?P<statistic>median|best|least|greatest|error) (?P<format>[+,]*\.?\d*[defg])(?: (?P<factor>[*/][\d.]+))?"
)
WORD = r"(?:two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|twenty|a hundred) "
# Numbers in README's prose that are not measured.
ALLOWED = [
    r"\b(?:19|20)\d\d\b",  # years
    r"\d+ ?[×x] ?\d+",  # sizes
    r"\d+(?:\.\d+)* nm\b",  # wavelengths
    r"\b(?:Mitsuba|mitransient|Rust|Zarr|Python|AVX|Apache|version|sec\.|depth|Figure)[ (v-]*\d+(?:\.\d+)*",
    r"\b\d+ (?:elements|wavelengths?|materials|states|captures|time bins|samples|cores?|threads?|slices|scenes|pixels)\b",
    r"#\d+",  # issues
    r"\b\d+D\b",
]
# Units of measured numbers in docs/.
UNITS = r"(?:million|thousand|times as|min\b|minutes|hours|s\b|ms\b|seconds|M/s|M[iB]B?\b|GB\b|% of)"
MEASURED = rf"\b(?:{WORD}|\d[\d.,]*(?:·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)? ?){UNITS}"
PAGES = ["README.md", "CHANGELOG.md", "CONVENTIONS.md", "scenes/README.md", "pbrdf/README.md"]
CLAIMING = ["README.md", "scenes/README.md"]


@dataclass
class Project:
    """A project in a folder, and its errors."""

    root: Path
    wrong: list = field(default_factory=list)
    loaded: dict = field(default_factory=dict)
    # The content of validation/numbers.toml.
    numbers: dict = field(init=False)

    def __post_init__(self):
        self.numbers = tomllib.loads((self.root / "validation/numbers.toml").read_text())

    def say(self, place, text):
        self.wrong.append(f"{place}: {text}")

    def claiming(self):
        """Pages whose numbers are claims."""
        named = [self.root / name for name in CLAIMING]
        return [page for page in named + sorted((self.root / "docs").glob("**/*.md")) if page.exists()]

    def name(self, page):
        return page.relative_to(self.root).as_posix()

    def result(self, name):
        """Return a result file, or None."""
        if name not in self.loaded:
            path = self.root / f"validation/results/{name}.json"
            try:
                self.loaded[name] = json.loads(path.read_text())
            except FileNotFoundError:
                self.loaded[name] = None
            except ValueError as e:
                self.say(self.name(path), f"is no JSON: {e}")
                self.loaded[name] = None
        return self.loaded[name]


# Numbers -------------------------------------------------------------------------------------------------------------


def printed(value, style, factor):
    """Return a number as a page shows it."""
    if factor:
        value = value * float(factor[1:]) if factor[0] == "*" else value / float(factor[1:])
    text = format(round(value) if style.endswith("d") else value, style)
    if "e" in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}·10" + str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return text.replace("-", "−")


def claimed(project, source, place):
    """Return the value that a number of this source must have, or None (which is reported) if the value is unknown."""
    claim = SOURCE.fullmatch(source)
    if claim is None:
        return project.say(place, f"invalid source: {source!r}")
    result = project.result(claim["file"])
    if result is None:
        return project.say(place, f"there is no result validation/results/{claim['file']}.json")
    number = result.get("numbers", {}).get(claim["name"])
    if number is None:
        return project.say(place, f"{claim['file']}.json has no number {claim['name']}")
    value = number.get(claim["statistic"])
    if value is None:
        return project.say(place, f"{claim['file']}.json has no {claim['statistic']} of {claim['name']}")
    try:
        return printed(value, claim["format"], claim["factor"])
    except ValueError as e:
        return project.say(place, f"{claim['format']}: {e}")


def listed(project, page):
    """Return the text of a page, and its listed numbers: begin, end and source of each."""
    text, name, found = page.read_text(), project.name(page), []
    for around, sources in project.numbers.get(name, {}).items():
        sources = [sources] if isinstance(sources, str) else sources
        plain = [r"\s+".join(map(re.escape, re.split(r"\s+", part))) for part in around.split("{}")]
        matches = list(re.finditer(f"({NUMBER})".join(plain), text))
        if len(matches) != 1 or len(plain) != len(sources) + 1:
            times = f"is there {len(matches)} times" if len(matches) != 1 else f"has {len(plain) - 1} numbers and {len(sources)} sources"
            project.say(name, f"the text {around!r} of validation/numbers.toml {times}")
            continue
        found += [(*matches[0].span(k), source) for k, source in enumerate(sources, 1)]
    return text, sorted(found)


def check_claims(project, page, text, numbers):
    """Check that numbers equal those of the results, whose scripts the page must name."""
    name, files = project.name(page), set()
    for start, end, source in numbers:
        if source == "given":
            continue
        place = f"{name}:{text.count(chr(10), 0, start) + 1}"
        want, file = claimed(project, source, place), source.split(":")[0]
        files.add(file)
        if want is not None and want != text[start:end].replace("-", "−"):
            project.say(place, f"says {text[start:end]}, {file}.json's {source.split(':')[-1]} is {want}")
    for file in sorted(files):
        if (result := project.result(file)) and result.get("script", "?") not in text:
            project.say(name, f"does not name {result.get('script')}, which wrote {file}.json")


def write_claims(project, page):
    """Write the results' numbers into the page; return true if the page changed."""
    text, numbers = listed(project, page)
    new = text
    for start, end, source in reversed(numbers):
        if source != "given" and (want := claimed(project, source, project.name(page))) is not None:
            new = new[:start] + want + new[end:]
    if new != text:
        page.write_text(new)
    return new != text


# Prose ----------------------------------------------------------------------------------------------------------------


def prose(text):
    """Return the lines of a page without code and link targets; the number of lines is unchanged."""
    blank = lambda match: "\n" * match[0].count("\n")
    text = re.sub(r"(?ms)^ *```.*?^ *```$", blank, text)
    text = re.sub(r"(?s)<!--.*?-->", blank, text)
    text = re.sub(r"(?m)^(?: {4}|\t).*$", "", text)
    text = re.sub(r"!\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return re.sub(r"`[^`]*`", "", text).split("\n")


def check_prose(project, page, text, numbers):
    """Report numbers that are not listed."""
    strict = page.name == "README.md" and page.parent == project.root
    for start, end, _ in reversed(numbers):
        text = text[:start] + text[end:]
    for number, line in enumerate(prose(text), 1):
        for allowed in ALLOWED:
            line = re.sub(allowed, "", line)
        pattern = rf"(?<![\w.])\d[\d.,]*|\b{WORD}(?:million|thousand|times)\b" if strict else MEASURED
        for found in re.finditer(pattern, line):
            project.say(f"{project.name(page)}:{number}", f"{found[0].strip('.,')!r} is not listed (… {line.strip()[:60]} …)")


def check_front(project):
    """Check that README starts with the two commands and is short."""
    text = (project.root / "README.md").read_text()
    block = re.search(r"(?ms)^```\w*\n(.*?)^```$", text)
    first = [line.split("#")[0].strip() for line in block[1].splitlines()] if block else []
    if first[: len(COMMANDS)] != COMMANDS:
        project.say("README.md", f"does not start with the commands {COMMANDS}")
    words = sum(len(re.findall(r"\w[\w'’.-]*", line)) for line in prose(text))
    if words > MINUTES * WORDS_A_MINUTE:
        project.say("README.md", f"has {words} words, more than can be read in {MINUTES} minutes ({MINUTES * WORDS_A_MINUTE})")


# Links ----------------------------------------------------------------------------------------------------------------


def anchors(page):
    """Return the anchors of a page's headings."""
    text = re.sub(r"(?ms)^```.*?^```$", "", page.read_text())
    plain = (re.sub(r"[^\w\- ]", "", title.lower()) for title in re.findall(r"(?m)^#+ +(.*?) *$", text))
    return {title.strip().replace(" ", "-") for title in plain}


def check_links(project):
    """Check that relative links lead to existing files and headings."""
    pages = [project.root / name for name in PAGES] + sorted((project.root / "docs").glob("**/*.md"))
    for page in filter(Path.exists, pages):
        text = re.sub(r"(?ms)^ *```.*?^ *```$", "", page.read_text())
        for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`]*`", "", text)):
            if re.match(r"\w+:", target):
                continue
            path, _, anchor = target.partition("#")
            to = (page.parent / path).resolve() if path else page
            if not to.exists():
                project.say(project.name(page), f"links to {target}, which does not exist")
            elif anchor and to.suffix == ".md" and anchor not in anchors(to):
                project.say(project.name(page), f"links to {target}, a heading that does not exist")


# Age ------------------------------------------------------------------------------------------------------------------


def check_age(project):
    """Check that results come from known and recent commits."""
    git = lambda *arguments: result_file.git(*arguments, root=project.root)
    if git("rev-parse", "HEAD") is None:
        return project.say("validation/results", "their age is unknown: this is not a git repository")
    shallow = git("rev-parse", "--is-shallow-repository") == "true"
    for path in sorted((project.root / "validation/results").glob("*.json")):
        place, result = project.name(path), project.result(path.stem)
        if result is None or path.stem in UNQUOTED:
            continue
        missing = {"format", "script", "measures", "commit", "dirty", "date", "machine", "numbers"} - result.keys()
        if missing or result["format"] != result_file.FORMAT:
            project.say(place, f"is not of format {result_file.FORMAT}; without {sorted(missing)}")
            continue
        script, commit, measures = result["script"], result["commit"], result["measures"]
        if not (project.root / script).exists():
            project.say(place, f"was written by {script}, which does not exist")
        if result["dirty"]:
            project.say(place, f"was measured on a changed tree: commit, then run {script} --record")
        known = commit and git("cat-file", "-e", f"{commit}^{{commit}}") is not None
        if not known and shallow:
            project.say(place, f"its age is unknown: this clone is shallow and lacks {commit}; fetch the whole history")
        elif not known:
            project.say(place, f"was measured at {commit}, which this repository does not know: run {script} --record")
        elif git("merge-base", "--is-ancestor", commit, "HEAD") is None:
            project.say(place, f"was measured at {commit[:10]}, which is not in the history of HEAD: run {script} --record")
        elif not any((project.root / m).exists() for m in measures):
            project.say(place, f"measures {measures}, none of which exists")
        else:
            changes = ["log", "--first-parent", "--diff-merges=first-parent", "--no-patch", "--format=%H", f"-G{CODE}", f"{commit}..HEAD"]
            count = len(git(*changes, "--", *measures).split())
            if count > AGE:
                since = f"{count} commits have since touched what it measures, {AGE} may: run {script} --record"
                project.say(place, f"was measured at {commit[:10]}; {since}")


def check(root):
    """Return all errors."""
    project = Project(root)
    for page in project.claiming():
        text, numbers = listed(project, page)
        check_claims(project, page, text, numbers)
        check_prose(project, page, text, numbers)
    for name in sorted(project.numbers.keys() - {project.name(page) for page in project.claiming()}):
        project.say("validation/numbers.toml", f"lists numbers of {name}, which is no page")
    check_front(project)
    check_links(project)
    check_age(project)
    return project.wrong


# Self-test ------------------------------------------------------------------------------------------------------------


class Sample:
    """A small project in a folder, correct until an error is planted."""

    def __init__(self, root):
        self.root = root
        (root / "validation/results").mkdir(parents=True)
        (root / "docs").mkdir()
        (root / "src").mkdir()
        (root / "src/a.rs").write_text("// 0\n")
        (root / "validation/speed.py").write_text("")
        self.git("init", "-q", "-b", "main")
        self.commit("first")
        self.result()
        commands = "\n".join(COMMANDS)
        front = f"# P\n\n```sh\n{commands}\n```\n\nBy `validation/speed.py`: "
        self.page(
            front + "it takes 1.23 s, at most 2,500 ms, error 5.7·10⁻³, shift\n −0.3, of 77 rooms in 2021, `12 in code`. See "
            "[more](docs/a.md#one-more-page).\n"
        )
        self.list(
            '["README.md"]\n"takes {} s, at most {}" = ["speed:t.median .2f", "speed:t.greatest ,.0f *1000"]\n'
            '"error {}" = "speed:t.error .1e"\n"shift {}" = "speed:shift.median +.1f"\n"of {} rooms" = "given"\n'
        )
        (root / "docs/a.md").write_text("# One more page\n\nBack to [the front](../README.md).\n")

    def git(self, *arguments):
        identity = ["-c", "user.name=self-test", "-c", "user.email=self-test@localhost", "-c", "commit.gpgsign=false"]
        done = subprocess.run(["git", *identity, *arguments], cwd=self.root, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    def commit(self, text):
        self.git("add", "-A")
        self.git("commit", "-q", "--allow-empty", "-m", text)

    def page(self, text=None, old=None, new=None, path="README.md"):
        path = self.root / path
        if old is not None:
            text = path.read_text()
            assert old in text, old
            text = text.replace(old, new)
        path.write_text(text)

    def list(self, text=None, **change):
        self.page(text, path="validation/numbers.toml", **change)

    def result(self, **changes):
        number = {"unit": "s", "spread": "5 rounds", "median": 1.2345, "best": 1.0, "least": 1.0, "greatest": 2.5, "error": 0.00571}
        head = {
            "format": result_file.FORMAT, "script": "validation/speed.py", "measures": ["src"], "commit": self.git("rev-parse", "HEAD"),
            "dirty": False, "date": "2026-01-01T00:00:00Z", "machine": {}, "numbers": {"t": number, "shift": {"median": -0.31}},
        }
        (self.root / "validation/results/speed.json").write_text(json.dumps(head | changes))

    def touch(self, count, file="src/a.rs", line="const K: u32 = {};"):
        for k in range(count):
            (self.root / file).write_text(line.format(k + 1) + "\n")
            self.commit(f"change {k}")


PLANTED = {
    "a wrong number": (lambda p: p.page(old="1.23 s", new="1.24 s"), "says 1.24"),
    "a wrong last digit of thousands": (lambda p: p.page(old="2,500", new="2,501"), "says 2,501"),
    "a wrong sign": (lambda p: p.page(old="−0.3", new="+0.3"), "says +0.3"),
    "a wrong exponent": (lambda p: p.page(old="10⁻³", new="10⁻⁴"), "says 5.7·10⁻⁴"),
    "a missing result": (lambda p: (p.root / "validation/results/speed.json").unlink(), "there is no result"),
    "a missing number": (lambda p: p.list(old="speed:t.median", new="speed:u.median"), "has no number u"),
    "a number without a value": (lambda p: p.list(old="shift.median", new="shift.best"), "has no best"),
    "a source that cannot be read": (lambda p: p.list(old="t.median .2f", new="t.middle .2f"), "invalid source"),
    "a number that is not listed": (lambda p: p.page(old="2021", new="2021, 1.23"), "'1.23' is not listed"),
    "a number in words": (lambda p: p.page(old="77 rooms", new="77 rooms and two million pixels"), "'two million' is not listed"),
    "a text that is not in the page": (lambda p: p.page(old="error 5.7", new="errors 5.7"), "'error {}' of validation/numbers.toml is there 0"),
    "a text that is there twice": (lambda p: p.page(old="2021", new="2021, error 5.7·10⁻³"), "is there 2 times"),
    "a page that is gone": (lambda p: p.list(old='["README.md"]', new='["docs/b.md"]\n"x" = []\n["README.md"]'), "which is no page"),
    "a source too few": (lambda p: p.list(old="s, at most {}", new="s, at most 2,500"), "has 1 numbers and 2 sources"),
    "a time in docs": (lambda p: (p.root / "docs/a.md").write_text("# One more page\n\nIt takes 46 minutes.\n"), "'46 minutes'"),
    "a script that is not named": (lambda p: p.page(old="`validation/speed.py`", new="a script"), "does not name"),
    "an old commit": (lambda p: p.touch(AGE + 1), f"{AGE + 1} commits have since touched"),
    "an unknown commit": (lambda p: p.result(commit="0123456789" * 4), "does not know"),
    "a commit of no history": (lambda p: p.result(commit=None), "does not know"),
    "a changed tree": (lambda p: p.result(dirty=True), "measured on a changed tree"),
    "a script that is gone": (lambda p: (p.root / "validation/speed.py").unlink(), "which does not exist"),
    "an old format": (lambda p: p.result(format=0), "is not of format"),
    "rooms that are gone": (lambda p: p.result(measures=["source"]), "none of which exists"),
    "a broken link": (lambda p: p.page(old="docs/a.md#", new="docs/b.md#"), "links to docs/b.md"),
    "a broken anchor": (lambda p: p.page(old="#one-more-page", new="#no-page"), "a heading that does not exist"),
    "another opening": (lambda p: p.page(old=COMMANDS[0], new="make"), "does not start with"),
    "a long README": (lambda p: p.page(old="See ", new="and on " * 800 + "See "), "words, more than"),
}


def self_test():
    """Check that every planted error is detected with its own message, and that a correct project has no errors."""
    bad = []

    def run(what, plant, expected):
        with tempfile.TemporaryDirectory() as folder:
            sample = Sample(Path(folder))
            plant(sample)
            wrong = check(sample.root)
        good = any(expected in line for line in wrong) if expected else not wrong
        print(f"{'found' if good and expected else 'fine' if good else 'NOT FOUND':10} {what}")
        if not good:
            bad.append(f"{what}: expected {expected!r} in {wrong}")

    run("nothing wrong", lambda p: None, None)
    run("the largest allowed number of commits", lambda p: p.touch(AGE), None)
    run("commits elsewhere", lambda p: p.touch(AGE + 5, "other.txt"), None)
    run("commits of comments", lambda p: p.touch(AGE + 5, line="    /// {} meters."), None)
    for what, (plant, expected) in PLANTED.items():
        run(what, plant, expected)

    def shallow(sample):
        """Make a shallow clone of a project with commits after the result."""
        sample.touch(2)
        (sample.root / "validation/results/speed.json").touch()
        subprocess.run(["git", "clone", "-q", "--depth", "1", f"file://{sample.root}", sample.root / "clone"], check=True)
        sample.root = sample.root / "clone"

    run("a shallow clone", shallow, "this clone is shallow")

    def written(sample):
        """Plant numbers that --write corrects."""
        for old, new in (("1.23 s", "9.87 s"), ("2,500", "9"), ("−0.3", "8.1")):
            sample.page(old=old, new=new)
        project = Project(sample.root)
        assert write_claims(project, sample.root / "README.md") and not project.wrong

    run("numbers that --write corrected", written, None)
    for line in bad:
        print(line, file=sys.stderr)
    return 1 if bad else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--check", action="store_true", help="fail if pages and results differ")
    what.add_argument("--write", action="store_true", help="write the results' numbers into the pages, then check")
    what.add_argument("--self-test", action="store_true", help="check that planted errors are detected")
    options = parser.parse_args()
    if options.self_test:
        return self_test()
    if options.write:
        project = Project(result_file.ROOT)
        for page in project.claiming():
            if write_claims(project, page):
                print(f"wrote {project.name(page)}")
    wrong = check(result_file.ROOT)
    for line in wrong:
        print(line, file=sys.stderr)
    print(f"{len(wrong)} errors" if wrong else "README.md and docs/ agree with the results")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
