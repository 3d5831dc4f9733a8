"""Pictures that lie elsewhere than in files: at a URL that fsspec reads, or in bytes.

Which stores can be read, and with whose credentials, is between fsspec and the user: s3:// needs
s3fs, gs:// gcsfs, https:// aiohttp; memory:// needs nothing.
"""

import io
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from animal3dbox.errors import ConfigError, SampleError, without_addresses

_URL = re.compile(r"([a-z][a-z0-9+.-]+)://[^\0]+")
LOCAL_SCHEMES = ("file", "local")
"""Schemes of the files of this machine, whose names lead below the folder of images or nowhere."""


class PictureUrl(str):
    """The URL of a picture, in the place of its file.

    Example:
        >>> PictureUrl("s3://bucket/photos/a.jpg").name
        'a.jpg'
    """

    __slots__ = ()

    @property
    def name(self) -> str:
        """The last part of the URL."""
        return self.rpartition("/")[2]


PicturePath = Path | PictureUrl
"""Where a picture lies."""
PictureSource = Path | str | bytes
"""Where a picture lies, a URL as any text; or its content."""
HEAD_BYTES = 1 << 16
"""So much of a JPEG at a URL is fetched for its header, which hardly any exceeds."""
_JPEG_BEGIN, _JPEG_END = b"\xff\xd8\xff", b"\xff\xd9"
_PNG_BEGIN, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_WHOLE = ((_JPEG_BEGIN, _JPEG_END), (_PNG_BEGIN, _PNG_END))
"""How pictures begin and end in the formats that have a mark of their end."""
_T = TypeVar("_T")


def is_remote(name: str) -> bool:
    """Whether a name is the URL of a store elsewhere.

    A chain of URLs, which may end in a file of this machine, is none.

    Example:
        >>> [is_remote(name) for name in ("s3://b/a.jpg", "file:///a.jpg", "a.jpg", "a::s3://b/c")]
        [True, False, False, False]
    """
    match = _URL.fullmatch(name)
    return match is not None and match[1] not in LOCAL_SCHEMES and "::" not in name


def picture_path(name: str) -> PicturePath | None:
    """The place of a picture by its text; None of an empty one, a picture in memory.

    Example:
        >>> picture_path("memory://a.jpg"), picture_path("a.jpg").name, picture_path("")
        ('memory://a.jpg', 'a.jpg', None)
    """
    if not name:
        return None
    return PictureUrl(name) if is_remote(name) else Path(name)


def check_remote_extra() -> None:
    """Raise a ConfigError that names the extra unless fsspec is installed."""
    try:
        import fsspec  # noqa: F401  # an optional dependency
    except ImportError as error:
        raise ConfigError(
            "pictures at URLs are read by fsspec: pip install 'animal3dbox[remote]', and what it"
            " needs for their store (s3fs for s3://, gcsfs for gs://, aiohttp for https://)"
        ) from error


def local_source(source: PictureSource, sample_id: str) -> Path | str | bytes:
    """A picture as it can be opened here: its file, or its bytes, fetched from a URL.

    Args:
        source: of the picture.
        sample_id: named in the error.

    Raises:
        ConfigError: it has a URL, and the extra is not installed.
        SampleError: the URL cannot be read, for whatever reason its store has.

    """
    if isinstance(source, bytes | Path) or not is_remote(source):
        return source
    return _fetched(source, sample_id)


def of_header(
    source: PictureSource,
    sample_id: str,
    read: Callable[[Path | str | bytes], _T],
    *,
    with_end: bool = False,
) -> _T:
    """What a function reads of a picture that needs no pixels.

    Of a JPEG at a URL the first HEAD_BYTES are fetched, and given to the function with the marker
    of an end behind them. Where they are not enough, or it is no JPEG, the whole picture is fetched
    and given. A small JPEG or PNG, or any picture of a store that knows no ranges, comes whole at
    once. Fewer bytes than asked for are the whole picture only if they end as one: a proxy may
    limit the length of ranges.

    Args:
        source: of the picture.
        sample_id: named in the error.
        read: from a picture as it can be opened here; raises OSError, SyntaxError or ValueError,
            such as SampleError, of what it cannot read.
        with_end: whether the picture must be whole: it is looked whether a JPEG of which the
            beginning is given ends as one does.

    Raises:
        ConfigError, SampleError: see local_source; or whatever the function raises of the whole.

    """
    if isinstance(source, bytes | Path) or not is_remote(source):
        return read(source)
    head = _some_bytes(source, 0, HEAD_BYTES)
    if head is not None and (len(head) > HEAD_BYTES or _is_whole(head)):
        return read(head)  # all that there is: of a store that knows no ranges, or a small file
    is_long = head is not None and len(head) == HEAD_BYTES and head.startswith(_JPEG_BEGIN)
    if head is not None and is_long and (not with_end or _ends_as_jpeg(source)):
        with suppress(OSError, SyntaxError, ValueError):  # its header may be longer
            return read(head + _JPEG_END)
    return read(local_source(source, sample_id))


def _is_whole(head: bytes) -> bool:
    """Whether the first bytes of a picture, at most HEAD_BYTES, are a JPEG or PNG to its end."""
    if len(head) == HEAD_BYTES:
        return False  # more may follow
    return any(head.startswith(begin) and head.endswith(end) for begin, end in _WHOLE)


def _ends_as_jpeg(url: str) -> bool:
    end = _some_bytes(url, -len(_JPEG_END), None)
    return end is not None and end.endswith(_JPEG_END)


def _some_bytes(url: str, begin: int, end: int | None) -> bytes | None:
    """Some bytes of a file, all of them if its store knows no ranges; None if that fails."""
    try:
        return _fetched(url, "", begin, end)
    except SampleError:  # which the whole picture has too, if it is not the range
        return None


def _fetched(url: str, sample_id: str, begin: int | None = None, end: int | None = None) -> bytes:
    """The content of a URL, or some bytes of it; errors as in local_source."""
    check_remote_extra()
    import fsspec

    try:
        filesystem, path = fsspec.core.url_to_fs(url)
        content: bytes = filesystem.cat_file(path, start=begin, end=end)
    except Exception as error:
        # Stores raise errors of their own kinds; none may end a run over a million pictures.
        message = without_addresses(str(error).replace(url, without_secrets(url)))
        reason = f"{type(error).__name__}: {message}" if message else type(error).__name__
        raise SampleError(
            sample_id,
            "image",
            f"{without_secrets(url)} cannot be read ({reason}); is it there, and have you the"
            " rights and the package for its store?",
        ) from error
    return content


def without_secrets(url: str) -> str:
    """A URL as it may be printed: without a user, a password, and what is asked for behind "?".

    Example:
        >>> without_secrets("https://me:secret@host/a.jpg?token=7")
        'https://host/a.jpg'
    """
    scheme, _, rest = url.partition("://")
    host, slash, path = rest.partition("/")
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{path.partition('?')[0]}"


def readable(source: Path | str | bytes) -> Path | str | io.BytesIO:
    """A local source as Pillow opens it."""
    return io.BytesIO(source) if isinstance(source, bytes) else source
