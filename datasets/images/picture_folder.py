"""The folder of a dataset's pictures, and where each of its names leads in it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from animal3dbox.datasets.images.named_files import (
    is_absolute_name,
    portable_name,
    resolve_inside,
)
from animal3dbox.datasets.images.photos import is_file, stored_size
from animal3dbox.datasets.images.remote_files import (
    PicturePath,
    PictureUrl,
    check_remote_extra,
    is_remote,
)
from animal3dbox.errors import SampleError

LOOKED_AT = 100
"""So many names at most are looked up to see whether pictures are where their names say."""
SEARCHED = 10
"""So many of them at most are searched for elsewhere: that goes through whole folders."""
_PLAIN_NAME = re.compile(r"(?!\.{1,2}(?:/|$))[^/\\\0]+(?:/(?!\.{1,2}(?:/|$))[^/\\\0]+)*")


def is_plain_name(name: str) -> bool:
    r"""Whether a name leads to a file below a folder without being looked up.

    Example:
        >>> [is_plain_name(name) for name in ("a/b.jpg", "../b.jpg", "C:/b.jpg", "a\\b.jpg", "")]
        [True, False, False, False, False]
    """
    return _PLAIN_NAME.fullmatch(name) is not None and not is_absolute_name(name)


@dataclass
class PictureFolder:
    """The pictures of a dataset, looked up while its annotations are read, or later.

    Attributes:
        root: the folder.
        checks: whether every picture is looked up now; else only those whose names are not plain,
            or whose size the annotations do not say.
        was_asked: whether anything was looked up, so that what was read holds for these pictures.
    """

    root: Path
    checks: bool = True
    was_asked: bool = field(default=False, init=False)
    _has_remote: bool | None = field(default=None, init=False)

    @cached_property
    def home(self) -> Path:
        """The folder without links."""
        return self.root.resolve()

    def takes_plainly(self, name: str) -> bool:
        """Whether a name is taken as it stands: a plain one, or a URL that is read from its store.

        URLs are the names of files below the folder if the first one is, as of a dataset that was
        downloaded.
        """
        if not is_remote(name):
            return is_plain_name(name)
        if self._has_remote is None:
            self._has_remote = portable_name(self.root, name) == name
            if self._has_remote:
                check_remote_extra()
        return self._has_remote

    def name(self, name: str) -> str:
        """A picture's name as outputs may hold it; see portable_name."""
        if self.takes_plainly(name):
            return name
        self.was_asked = True
        return portable_name(self.root, name)

    def path(self, name: str, sample_id: str) -> PicturePath:
        """A picture's file, or if it is not looked up now, where its name says; or its URL.

        Raises:
            SampleError: it was looked up, and is not there; see resolve_inside.

        """
        if self.takes_plainly(name):
            if is_remote(name):
                return PictureUrl(name)
            if not self.checks:
                return self.home / name
        self.was_asked = True
        return resolve_inside(self.root, name, sample_id, "file_name", home=self.home)

    def stored_size(self, name: str, sample_id: str, *, upright: bool) -> tuple[int, int]:
        """Height and width of a picture by its header; see photos.stored_size."""
        self.was_asked = True
        path = PictureFolder(self.root).path(name, sample_id)
        return stored_size(path, sample_id, upright=upright)

    def is_elsewhere(self, names: Sequence[str]) -> bool:
        """Whether a dataset's pictures are not where its names say, but somewhere below the folder.

        Without any picture, none is elsewhere.

        Args:
            names: a few of the dataset's, LOOKED_AT or so, which decide.

        """
        names = [name for name in names if not is_remote(name)]
        if any(is_file(self.home / name) for name in names):
            return False
        return any(map(self._is_found, names[:: max(len(names) // SEARCHED, 1)]))

    def _is_found(self, name: str) -> bool:
        try:
            resolve_inside(self.root, name, name, "file_name", home=self.home)
        except SampleError:
            return False
        return True
