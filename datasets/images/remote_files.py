"""Pictures that lie elsewhere than in files: at a URL that fsspec reads, or in bytes.

Which stores can be read, and with whose credentials, is between fsspec and the user: s3:// needs
s3fs, gs:// gcsfs, https:// aiohttp; memory:// needs nothing.
"""

import io
import re
from pathlib import Path

from animal3dbox.errors import ConfigError, SampleError

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
    check_remote_extra()
    import fsspec

    try:
        with fsspec.open(source, "rb") as file:
            content: bytes = file.read()
    except Exception as error:
        # Stores raise errors of their own kinds; none may end a run over a million pictures.
        message = str(error).replace(source, without_secrets(source))
        reason = f"{type(error).__name__}: {message}" if message else type(error).__name__
        raise SampleError(
            sample_id,
            "image",
            f"{without_secrets(source)} cannot be read ({reason}); is it there, and have you the"
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
