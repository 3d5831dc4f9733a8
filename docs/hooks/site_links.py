"""Where links of the documents lead on the site, and what a page would load from elsewhere.

Documents link to files of the repository, so that they can be read there, too. On the site, a link
to a file that has a page leads to the page; of any other the words are left, for the site has no
copy of the sources.
"""

import posixpath
import re

from api_pages import doors, page_name
from page_links import FENCE, LINK, ROOT, is_external

ROOT_PAGES = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Documents of the repository's root -> their pages."""
PAGES_OF_FILES = {
    **ROOT_PAGES,
    "README.md": "index.md",
    "docs/tutorial.py": "tutorial.md",
    "animal3dbox/cli/jobs.py": "cli.md",
}
"""Files of the repository -> the pages that are made of them."""
LOADED = re.compile(
    r'<(?:script|img|source|iframe)\b[^>]*\bsrc="?(?:https?:)?//[^">]*'
    r'|<link\b[^>]*\brel="?(?:stylesheet|preload|preconnect)\b[^>]*href="?(?:https?:)?//[^">]*'
    r'|<link\b[^>]*href="?(?:https?:)?//[^">]*"?\s[^>]*\brel="?(?:stylesheet|preload|preconnect)\b'
)
"""What makes a browser fetch something from elsewhere."""


def page_target(page: str, target: str) -> str | None:
    """Where a link of a page leads on the site; None: to a file that has no page.

    Args:
        page: the page that has the link, from the site's root.
        target: the link as it stands in the document.

    Example:
        >>> page_target("install.md", "../SECURITY.md#what-is-promised")
        'security.md#what-is-promised'
        >>> page_target("contributing.md", "docs/paper.md"), page_target("teach.md", "../Makefile")
        ('paper.md', None)
    """
    path, dash, anchor = target.partition("#")
    if is_external(target) or not path:
        return target
    home = next((root for root, made in ROOT_PAGES.items() if made == page), f"docs/{page}")
    file = posixpath.normpath(posixpath.join(posixpath.dirname(home), path))
    made = PAGES_OF_FILES.get(file) or _api_page(file)
    if made is None and file.startswith("docs/"):
        made = file.removeprefix("docs/")
    if made is None:
        return None
    return posixpath.relpath(made, posixpath.dirname(page)) + dash + anchor


def _api_page(file: str) -> str | None:
    """The page of a door, by its `__init__.py` from the repository's root."""
    made = {path.relative_to(ROOT).as_posix(): page_name(door) for door, path in doors().items()}
    return made.get(file)


def mended_links(markdown: str, page: str) -> str:
    """The Markdown of a page with its links led to pages of the site, outside blocks of code.

    Example:
        >>> mended_links("[a](../CHANGELOG.md), [b](../Makefile), ![c](images/c.png)", "index.md")
        '[a](changelog.md), b, ![c](images/c.png)'
    """

    def mended(match: re.Match[str]) -> str:
        target = page_target(page, match[3])
        return match[2] if target is None else f"{match[1]}[{match[2]}]({target})"

    parts, end = list[str](), 0
    for fence in FENCE.finditer(markdown):
        parts += [LINK.sub(mended, markdown[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, LINK.sub(mended, markdown[end:])])


def loaded_from_elsewhere(html: str) -> str | None:
    """The first thing that a page would load from another place than the site; None: nothing.

    Example:
        >>> loaded_from_elsewhere('<a href="https://a.org">a</a> <img src="images/b.png">')
        >>> loaded_from_elsewhere('<script src="https://a.org/b.js"></script>')
        '<script src="https://a.org/b.js'
    """
    match = LOADED.search(html)
    return None if match is None else match[0]
