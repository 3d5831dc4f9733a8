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
from site_check import problems_of_site
from site_links import ROOT_PAGES, mended_links
from tutorial_page import SCRIPT, cells_of, run_cells, tutorial_files


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


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse a site in which a link leads nowhere, or that loads something from elsewhere."""
    problems = problems_of_site(Path(config.site_dir))
    if problems:
        raise PluginError("\n".join(problems))
