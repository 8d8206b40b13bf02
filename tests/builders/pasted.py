"""What a reader of the documentation is told to paste: blocks of commands, of Python and of files, as they stand."""

import re
import textwrap
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"^( *)```([^\n`]*)\n(.*?)^\1```$", flags=re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block: what it says it is, and what it holds."""

    kind: str
    text: str


def text_of(page):
    return page.read_text(encoding="utf-8")


def blocks_in(text):
    return [Block(kind.strip(), textwrap.dedent(inside)) for _, kind, inside in FENCE.findall(text)]


def of_kind(text, kind):
    return [block.text for block in blocks_in(text) if block.kind == kind]


def commands_in(text):
    """Lines of blocks of commands: each is pasted whole."""
    return [line for block in of_kind(text, "sh") for line in block.splitlines() if line]


def outside_of_blocks(text):
    return FENCE.sub("", text)
