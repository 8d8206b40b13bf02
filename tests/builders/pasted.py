"""What a reader of the documentation is told to paste: commands and Python, as they stand on its pages."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
# A line of a block that begins like this is typed into a shell, and its environment may come first.
TYPED = re.compile(
    r"(?:[A-Z_]+=\S+ )*(?:\S*/)?(?:sonocal|python3?|pip|scripts/\S+|\.ci/run|source|git)(?= |$)"
)


def text_of(page):
    return page.read_text(encoding="utf-8")


def commands_in(text):
    """Commands of indented blocks, lines that go on joined; what is said beside them left out."""
    joined = re.sub(r" \\\n +", " ", text)
    lines = re.findall(r"^ {4,}(\S.*)$", joined, flags=re.MULTILINE)
    return [command_of(line) for line in lines if TYPED.match(line)]


def command_of(line):
    """The line without its remark, which two spaces or a hash set apart."""
    return re.split(r"\s{2,}|\s+# ", line, maxsplit=1)[0]


def snippets_in(text):
    return re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
