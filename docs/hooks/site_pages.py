"""The hook of mkdocs: adds the pages that are made from the program, and mends links."""

from pathlib import Path
from typing import Any

from api_pages import api_pages
from command_pages import commands_page
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from page_links import ROOT
from site_links import ROOT_PAGES, loaded_from_elsewhere, mended_links
from tutorial_page import SCRIPT, cells_of, run_cells, tutorial_files

LARGEST_PICTURE = 300_000
"""Bytes."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    generated: dict[str, str | bytes] = {
        **{page: (ROOT / name).read_text() for name, page in ROOT_PAGES.items()},
        "cli.md": commands_page(),
        **api_pages(),
        **tutorial_files(run_cells(cells_of(SCRIPT.read_text()))),
    }
    for name, content in generated.items():
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: Any) -> str:
    """Lead the links of a page to pages of the site."""
    return mended_links(markdown, page.file.src_uri)


def on_post_page(output: str, *, page: Page, **_: Any) -> str:
    """Refuse a page that would load something from elsewhere."""
    found = loaded_from_elsewhere(output)
    if found is not None:
        raise PluginError(f"{page.file.src_uri} loads from elsewhere: {found}")
    return output


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse pictures that are too large."""
    for path in sorted(Path(config.site_dir).rglob("*")):
        is_picture = path.suffix in (".png", ".jpg", ".svg", ".gif")
        if is_picture and path.stat().st_size > LARGEST_PICTURE:
            raise PluginError(f"{path}: {path.stat().st_size} bytes, but at most {LARGEST_PICTURE}")
