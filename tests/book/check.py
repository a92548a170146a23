"""The book says what is: every page is in its contents, every link leads somewhere, every command runs.

    tests/book/check.py PROGRAM [PAGE...]

Of every page of docs/tutorial and docs/howto (or of PAGE) the commands are run with the program `kurs`, in a scratch folder of the page that
has `examples`, `scenarios` and `testdata` of the project in it:

* a fenced block `toml NAME`, `python NAME` or any other with a name is a file of the reader, whose name the text above it says;
* a fenced block `console` has commands behind `$ ` (a backslash goes on in the next line), and lines that the command prints, in this
  order; `…` in them stands for any text, other lines may come between. The exit status is 0 or that of a line `[exit status N]`.

Pages whose commands need the Python module are skipped where it is not installed. In all pages, in whatever block or line, options of `kurs` and
examples, tests and scripts of the project are looked up. A comment `<!-- FILE: NAME = VALUE, … -->` beside numbers in the text holds
them to the constants of a source file.
"""

import os
import re
import subprocess
import sys
import tempfile
import tomllib
from glob import glob
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
RUN = ("tutorial", "howto")
FENCE = re.compile(r"^```(\S*) *(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SOURCE = re.compile(r"^<!-- (\S+\.rs): (.*) -->$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
#: Scripts of the project, and its examples.
FILE = re.compile(
    r"\b(?:(?:bench|tests|tests-referees|fuzz)/[\w/-]+(?:\.py|\.sh|/run)\b|(?:crates/[\w-]+/)?(?:examples|scenarios)/[\w/.-]*\w)"
)
#: No command takes more than some seconds; on a machine with other work it may. Beyond this it hangs, s.
PATIENCE_S = 300


def main():
    program = Path(sys.argv[1]).resolve()
    wanted = [Path(page).resolve() for page in sys.argv[2:]]
    pages = sorted(DOCS.rglob("*.md"))
    faults = [*contents(pages), *links([*pages, *ROOT.glob("*.md")]), *names(pages, program), *constants(pages), *packaged()]
    for page in wanted or [page for page in pages if page.parent.name in RUN]:
        faults += commands(page, program)
    for fault in faults:
        print(fault)
    sys.exit(1 if faults else 0)


def told(page, text, at, what):
    return f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, at) + 1}: {what}"


def contents(pages):
    """Pages that are not in SUMMARY.md, or are there and not on the disk."""
    summary = DOCS / "SUMMARY.md"
    listed = {(DOCS / link).resolve() for link in LINK.findall(summary.read_text())}
    there = set(pages) - {summary}
    yield from (f"docs/SUMMARY.md: {page.relative_to(DOCS)} is missing in it" for page in sorted(there - listed))
    yield from (f"docs/SUMMARY.md: {page} is not there" for page in sorted(listed - there))


def anchor(heading):
    """What links to a heading have behind the #, as GitHub and mdBook make it."""
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


def links(pages):
    for page in pages:
        text = page.read_text()
        for link in LINK.finditer(text):
            path, _, part = link[1].partition("#")
            if ":" in path:
                continue
            target = (page.parent / path).resolve() if path else page
            if not target.exists():
                yield told(page, text, link.start(), f"link to {link[1]}, which is not there")
            elif page.is_relative_to(DOCS) and (target.is_dir() or not target.is_relative_to(DOCS)):
                yield told(page, text, link.start(), f"link to {link[1]}, out of the book: its web pages have no such file")
            elif part and part not in {anchor(h) for h in re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)}:
                yield told(page, text, link.start(), f"link to {link[1]}: no such heading")


def constants(pages):
    """Constants that a page gives another value than the source does."""
    for page in pages:
        text = page.read_text()
        for comment in SOURCE.finditer(text):
            source = (ROOT / comment[1]).read_text()
            for name, value in (item.split(" = ") for item in comment[2].split(", ")):
                in_source = re.search(rf"const {name}: \w+ = (.*);", source)
                if not in_source or in_source[1] != value:
                    found = in_source[1] if in_source else "not there"
                    yield told(page, text, comment.start(), f"{name} = {value}, in {comment[1]} it is {found}")


def names(pages, program):
    """Options, examples, tests and scripts that are named and do not exist."""
    helps = {}
    for page in pages:
        text = page.read_text()
        for call in re.finditer(r"\bkurs ([a-z]+)((?: [a-z-]+)?)([^\n`|&;]*)", text):
            # `kurs calibrate six-position` is a command of its own; words that are none are prose.
            whole = (call[1], *call[2].split())
            for words in (whole, whole[:1]):
                if words not in helps:
                    done = subprocess.run([program, *words, "--help"], capture_output=True, text=True)
                    helps[words] = "" if done.returncode else done.stdout
            known = helps[whole] or helps[whole[:1]]
            for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", call[3].split(" #")[0]):
                if known and option not in known:
                    yield told(page, text, call.start(), f"kurs {' '.join(whole)} has no {option}")
        for call in re.finditer(r"-p (kurs[a-z-]*) --(example|test|bench) (\w+)", text):
            crate, folder = ROOT / "crates" / call[1], {"bench": "benches"}.get(call[2], call[2] + "s")
            declared = f'name = "{call[3]}"' in (crate / "Cargo.toml").read_text()
            if not declared and not any((crate / folder / name).exists() for name in (f"{call[3]}.rs", call[3])):
                yield told(page, text, call.start(), f"{call[1]} has no {call[2]} {call[3]}")
        for file in FILE.finditer(text):
            if not (ROOT / file[0]).exists():
                yield told(page, text, file.start(), f"{file[0]} is not there")


def packaged():
    """Examples and scenarios, of which the book speaks, that the Debian package leaves out."""
    crate = ROOT / "crates/kurs-cli"
    assets = tomllib.loads((crate / "Cargo.toml").read_text())["package"]["metadata"]["deb"]["assets"]
    there = {Path(file).resolve() for source, *_ in assets for file in glob(str(crate / source), recursive=True)}
    for folder in ("examples", "scenarios"):
        wanted = {file.resolve() for file in (ROOT / folder).rglob("*") if file.is_file()}
        yield from (f"crates/kurs-cli/Cargo.toml: {file.relative_to(ROOT)} is not packaged" for file in sorted(wanted - there))


def commands(page, program):
    text = page.read_text()
    blocks = list(FENCE.finditer(text))
    if any("$ python3" in block[3] for block in blocks if block[1] == "console") and not has_module():
        print(f"skipped: {page.relative_to(ROOT)}, no Python module kurs")
        return
    with tempfile.TemporaryDirectory(prefix="kurs-book-") as scratch:
        folder = Path(scratch)
        for name in ("examples", "scenarios", "testdata"):
            (folder / name).symlink_to(ROOT / name)
        (folder / ".bin").mkdir()
        (folder / ".bin/kurs").symlink_to(program)
        (folder / ".bin/python3").symlink_to(sys.executable)
        path = f"{folder / '.bin'}:{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        for block in blocks:
            if block[2]:
                if f"`{block[2]}`" not in text[: block.start()]:
                    yield told(page, text, block.start(), f"nothing above says that this is `{block[2]}`")
                (folder / block[2]).parent.mkdir(parents=True, exist_ok=True)
                (folder / block[2]).write_text(block[3])
            elif block[1] == "console":
                for command, expected in calls(block[3]):
                    fault = call(command, expected, folder, environment)
                    if fault:
                        yield told(page, text, block.start(), fault)


def has_module():
    return subprocess.run([sys.executable, "-c", "import kurs"], capture_output=True).returncode == 0


def calls(block):
    """Commands of a console block and the lines that they print."""
    found = []
    for line in block.replace("\\\n", " ").splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        elif line.strip() and found:
            found[-1][1].append(line)
    return found


def call(command, expected, folder, environment):
    """Runs a command; what is other than expected, or nothing."""
    try:
        done = subprocess.run(
            ["bash", "-c", f"set -o pipefail; {command}"],
            cwd=folder, env=environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S,
        )
    except subprocess.TimeoutExpired:
        return f"`{command}` takes more than {PATIENCE_S} s"
    status, printed = 0, done.stdout
    lines = [" ".join(line.split()) for line in printed.splitlines()]
    for line in expected:
        if told_status := re.fullmatch(r"\[exit status (\d+)\]", line.strip()):
            status = int(told_status[1])
            continue
        pattern = ".*".join(re.escape(part.strip()) for part in " ".join(line.split()).split("…"))
        at = next((k for k, found in enumerate(lines) if re.fullmatch(pattern.replace(".*", " ?.* ?"), found)), None)
        if at is None:
            return f"`{command}` does not print `{line.strip()}`, but\n{printed}"
        lines = lines[at + 1 :]
    if done.returncode != status:
        return f"`{command}` ends with {done.returncode}, not {status}:\n{printed}"
    return None


if __name__ == "__main__":
    main()
