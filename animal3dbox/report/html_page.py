"""HTML from templates that lie beside the code, with every value escaped."""

from functools import cache
from importlib import resources
from typing import Any

import jinja2


def render(package: str, template: str, **values: Any) -> str:
    """A template filled with values, as HTML.

    Every value is escaped, so that a sample's name cannot put tags into the page. A value that the
    template uses and that is missing is an error, not an empty string.

    Args:
        package: the package in whose folder the template lies.
        template: the file's name.
        **values: what the template shows, by its own names.

    """
    return _environment(package).get_template(template).render(values)


@cache
def _environment(package: str) -> jinja2.Environment:
    folder = resources.files(package)
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: folder.joinpath(name).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
