"""What the tests of the documentation need to know of a page: its blocks, headings and links."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"

_FENCE = re.compile(r"^( *)(`{3,})(\S*)[^\n]*\n(.*?)^\1\2[ ]*$", re.MULTILINE | re.DOTALL)
_HEADING = re.compile(r"^(#{1,4}) +(.+?) *$", re.MULTILINE)
_LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+(?:\([^()]*\))?[^()\s]*)\)")


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: its language, its text, the line it begins at and the heading above it."""

    language: str
    text: str
    line: int
    heading: str


@dataclass(frozen=True, slots=True)
class Page:
    """A Markdown page."""

    path: Path
    text: str

    @property
    def name(self) -> str:
        """Its path from the root of the repository."""
        return self.path.relative_to(ROOT).as_posix()

    @property
    def blocks(self) -> list[Block]:
        """Its fenced blocks in order."""
        return list(self._blocks())

    def _blocks(self) -> Iterator[Block]:
        for match in _FENCE.finditer(self.text):
            above = [each for each in self.headings if each[0] < match.start()]
            line = self.text.count("\n", 0, match.start()) + 1
            yield Block(match[3].strip("{}"), textwrap.dedent(match[4]), line, above[-1][1] if above else "")

    @property
    def prose(self) -> str:
        """The text with the fenced blocks blanked out."""
        return _FENCE.sub(lambda match: " " * len(match[0]), self.text)

    @property
    def headings(self) -> list[tuple[int, str]]:
        """Place and text of each heading."""
        return [(match.start(), match[2]) for match in _HEADING.finditer(self.prose)]

    @property
    def anchors(self) -> set[str]:
        """What a link into this page may name, as repository browsers and the site make it from the headings."""
        return {slug(text) for _, text in self.headings}

    @property
    def links(self) -> list[str]:
        """The targets of its links and pictures."""
        return [match[1] for match in _LINK.finditer(self.prose)]


def slug(heading: str) -> str:
    """The anchor of a heading."""
    plain = re.sub(r"[`*]", "", heading).lower()
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


def pages() -> list[Page]:
    """Every page that a reader meets: the documentation's, those at the root and that beside the notebooks."""
    found = sorted(each for each in DOCS.rglob("*.md") if not any(part.startswith("_") for part in each.parts))
    others = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "notebooks" / "README.md"]
    return [Page(each, each.read_text(encoding="utf-8")) for each in [*others, *found] if each.exists()]


def page(name: str) -> Page:
    """One page of the documentation by its path below ``docs``."""
    return Page(DOCS / name, (DOCS / name).read_text(encoding="utf-8"))


def block_of(where: str, heading: str, language: str) -> str:
    """The text of the first block of a language below a heading."""
    found = page(where).blocks
    return next(each.text for each in found if each.heading == heading and each.language == language)
