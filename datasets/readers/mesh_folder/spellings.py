"""Names of files that are an image's but for their letter case or Unicode form.

One system writes A.JPG and a.obj, another one takes the accents of a name apart: names are matched
as people read them, where that leads to one image.
"""

import re
from collections.abc import Iterable

from animal3dbox.datasets.images.named_files import plain_name

NUMBERED = re.compile(r"(?P<name>.+)(?P<number>[._]\d+)")
"""A name with the number of one of several animals."""


class Spellings:
    """The names that files may have, each the only one that is spelled as it is.

    Args:
        names: of images without suffix, as their folder has them.

    Example:
        >>> spellings = Spellings(["Dog", "cat", "Cat"])
        >>> spellings.own_spelling("DOG_1"), spellings.own_spelling("CAT")
        ('Dog_1', 'CAT')
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.exact = frozenset(names)
        self._alike: dict[str, list[str]] = {}
        for name in sorted(self.exact):
            self._alike.setdefault(plain_name(name), []).append(name)

    def alike(self, name: str) -> list[str]:
        """The names that are spelled like this one but for letter case and Unicode form."""
        return [name] if name in self.exact else self._alike.get(plain_name(name), [])

    def is_exact(self, name: str) -> bool:
        """Whether a name, with or without an animal's number, is spelled as an image's."""
        match = NUMBERED.fullmatch(name)
        return name in self.exact or (match is not None and match["name"] in self.exact)

    def own_spelling(self, name: str) -> str:
        """A name as the one image of that name is spelled, with its number if it has one.

        A name stays as it is if it is no image's, or may be that of several.
        """
        if self.is_exact(name):
            return name
        match = NUMBERED.fullmatch(name)
        parts = [(name, "")] + ([] if match is None else [(match["name"], match["number"])])
        for part, number in parts:
            if len(alike := self.alike(part)) == 1:
                return alike[0] + number
        return name
