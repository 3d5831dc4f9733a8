"""A griffe extension: docstrings as griffe and Markdown understand them.

The `Example:` of a docstring is what griffe calls `Examples:`; without that the lines after `>>>`
would be read as Markdown, and `a[0][1]` as a link. The `::` before a drawing is one colon.
"""

import re
from typing import Any

import griffe


class ExampleSections(griffe.Extension):
    """Changes each docstring when it has been collected."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring of one module, class, function or attribute."""
        if obj.docstring is not None:
            text = re.sub(r"^Example:$", "Examples:", obj.docstring.value, flags=re.MULTILINE)
            obj.docstring.value = re.sub(r"::$", ":", text, flags=re.MULTILINE)
