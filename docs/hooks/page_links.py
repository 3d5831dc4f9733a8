"""Links and headings of the documents: what the tests check and the site rewrites.

Run: python docs/hooks/page_links.py  (lists every address outside the repository, by page)
"""

import re
import sys
import unicodedata
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"(?<!`)(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]*)\)")
"""A link or a picture: its "!", its words and its target."""
FENCE = re.compile(r"^```.*?^```[ \t]*$", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^(#{1,6}) (.+)$", re.MULTILINE)


def pages() -> list[Path]:
    """The documents that people read: those of the root, of docs/ and of .github/."""
    folders = (ROOT, ROOT / "docs", ROOT / ".github", ROOT / ".github" / "ISSUE_TEMPLATE")
    return sorted(path for folder in folders for path in folder.glob("*.md"))


def targets_of(text: str) -> list[str]:
    """What the links and pictures of a page lead to, outside its blocks of code.

    Example:
        >>> targets_of("[a](b.md#c) and ![d](images/d.png)")
        ['b.md#c', 'images/d.png']
    """
    return [match[3] for match in LINK.finditer(FENCE.sub("", text))]


def is_external(target: str) -> bool:
    """Whether a link leads out of the repository."""
    return re.match(r"[a-z]+:", target) is not None


def anchors_of(text: str) -> set[str]:
    r"""The anchors of a page's headings that the site and a forge's own view both have.

    Python-Markdown drops letters outside ASCII and joins dashes; forges keep the former and write
    a dash for every space. A heading that the two treat differently has no anchor here: no page may
    link to it.

    Example:
        >>> sorted(anchors_of("# The law\n## `basic`: EPnP\n## a & b\n"))
        ['basic-epnp', 'the-law']
    """
    return {
        anchor
        for _, heading in HEADING.findall(FENCE.sub("", text))
        if (anchor := _site_anchor(heading)) == _forge_anchor(heading)
    }


def _words(heading: str) -> str:
    """A heading as it is read: without marks of code, emphasis and links."""
    return re.sub(r"[`*]", "", LINK.sub(r"\2", heading)).strip().lower()


def _site_anchor(heading: str) -> str:
    ascii_words = unicodedata.normalize("NFKD", _words(heading)).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", ascii_words).strip())


def _forge_anchor(heading: str) -> str:
    return re.sub(r"[^\w\s-]", "", _words(heading)).replace(" ", "-")


def external_links() -> Iterator[tuple[str, str]]:
    """(page, address) of every link that leads out of the repository."""
    for page in pages():
        for target in targets_of(page.read_text()):
            if is_external(target):
                yield page.relative_to(ROOT).as_posix(), target


def main() -> None:
    """Print the external links; nothing is fetched."""
    for page, address in external_links():
        sys.stdout.write(f"{page}: {address}\n")


if __name__ == "__main__":
    main()
