"""Faults of the built site: links that lead nowhere, things from elsewhere, large pictures.

Run: python docs/hooks/site_check.py site
"""

import posixpath
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

from page_links import is_external
from site_links import loaded_from_elsewhere

LARGEST_PICTURE = 300_000
"""Bytes."""


class _Page(HTMLParser):
    """The ids of a page, and what its links and pictures lead to."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.ids, self.targets = set[str](), list[str]()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep the ids, and the targets of what is linked or shown."""
        for name, value in attrs:
            if value and name == "id":
                self.ids.add(value)
            elif value and (name, tag) in {("href", "a"), ("href", "link"), ("src", "img")}:
                self.targets.append(value)


def problems_of_site(site: Path) -> list[str]:
    """Every problem of a built site, by page; none is an empty list.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     page = '<h1 id="a">A</h1> <a href="#a">a</a> <a href="#b">b</a> <img src="c.png">'
        ...     _ = Path(folder, "index.html").write_text(page)
        ...     problems_of_site(Path(folder))
        ['index.html: #b leads nowhere', 'index.html: c.png leads nowhere']
    """

    @cache
    def read(path: Path) -> _Page:
        return _Page(path.read_text())

    problems = []
    for path in sorted(site.rglob("*.html")):
        name = path.relative_to(site).as_posix()
        found = loaded_from_elsewhere(path.read_text())
        if found is not None:
            problems.append(f"{name}: {found} would be loaded from elsewhere")
        for target in dict.fromkeys(read(path).targets):
            file, _, anchor = unquote(target).partition("#")
            if is_external(target) or file.startswith("/"):  # the latter on 404.html alone
                continue
            linked = path if not file else Path(posixpath.normpath(path.parent / file))
            if linked.is_dir():
                linked /= "index.html"
            is_page = linked.suffix == ".html"
            if not linked.is_file() or (anchor and is_page and anchor not in read(linked).ids):
                problems.append(f"{name}: {target} leads nowhere")
    return [*problems, *_large_pictures(site)]


def _large_pictures(site: Path) -> list[str]:
    """The pictures with too many bytes."""
    return [
        f"{path.relative_to(site)}: {path.stat().st_size} bytes, but at most {LARGEST_PICTURE}"
        for pattern in ("*.png", "*.jpg", "*.svg", "*.gif")
        for path in sorted(site.rglob(pattern))
        if path.stat().st_size > LARGEST_PICTURE
    ]


def main() -> None:
    """Print the problems of a folder, and fail if there are any."""
    problems = problems_of_site(Path(sys.argv[1]))
    sys.exit("\n".join(problems) if problems else 0)


if __name__ == "__main__":
    main()
