"""The user's Camera Trap Data Package: its version and the rows of its media.

https://camtrap-dp.tdwg.org has the standard. Of a package only datapackage.json and the media's
table are read.
"""

import csv
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec

from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError, SampleError

LATEST = "1.0.2"
KNOWN_VERSIONS = ("1.0", "1.0.1", LATEST)
"""Versions whose table of observations has the columns that are written."""
VERSION = re.compile(r"camtrap-dp/(?:v)?([0-9][0-9a-z.\-]*)/")
NEEDED = ("mediaID", "deploymentID", "timestamp", "filePath")
"""Columns that an observation of a media file copies from it, or is found by."""


class _Resource(msgspec.Struct):
    """One table of a package."""

    name: str = ""
    path: Any = None


class _Package(msgspec.Struct):
    """What is read of datapackage.json."""

    profile: str = ""
    resources: list[_Resource] = msgspec.field(default_factory=list)


@dataclass(frozen=True)
class CamtrapPackage:
    """A package's version, and its media by what an image may be called.

    Attributes:
        folder: of datapackage.json.
        version: of Camtrap DP.
        media: filePath -> the row of media.csv.
        by_name: the file's own name -> the filePaths of media that are called so.
    """

    folder: Path
    version: str
    media: Mapping[str, Mapping[str, str]]
    by_name: Mapping[str, tuple[str, ...]]

    def media_of(self, image: str, sample_id: str) -> Mapping[str, str]:
        """The row of the media file that an image is.

        It is the one whose filePath is the image's path or ends with it, else the only one with
        the same file name.

        Raises:
            SampleError: there is none, or more than one.

        """
        if image in self.media:
            return self.media[image]
        named = self.by_name.get(PurePosixPath(image).name, ())
        ending = [path for path in named if path.endswith(f"/{image}")]
        paths = ending or list(named)
        if len(paths) == 1:
            return self.media[paths[0]]
        problem = "no media file is called so"
        if paths:
            problem = f"{len(paths)} media files are called so, such as {paths[0]} and {paths[1]}"
        raise SampleError(
            sample_id,
            "image",
            f"is {image!r}, and in media.csv {problem}: an observation needs its media's IDs."
            " Label the images by the paths that media.csv gives them",
        )


def read_camtrap_package(folder: Path) -> CamtrapPackage:
    r"""Read a package's version and media.

    Args:
        folder: of datapackage.json, or that file.

    Raises:
        DatasetNotFoundError: datapackage.json or the media's table is not there.
        DatasetFormatError: one of them is not what the standard says.
        ConfigError: a version of Camtrap DP with other columns.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = (Path(folder) / "datapackage.json").write_text('{"resources": []}')
        ...     _ = (Path(folder) / "media.csv").write_text(
        ...         "mediaID,deploymentID,timestamp,filePath\n"
        ...         "m1,d1,2024-05-01T06:10:00Z,media/a.jpg\n"
        ...     )
        ...     package = read_camtrap_package(Path(folder))
        >>> package.version, package.media_of("a.jpg", "a")["mediaID"]
        ('1.0.2', 'm1')
    """
    file = folder if folder.is_file() else folder / "datapackage.json"
    package: _Package = decode_json(file, _Package)
    in_profile = VERSION.search(package.profile)
    version = in_profile.group(1) if in_profile else LATEST
    if version not in KNOWN_VERSIONS:
        raise ConfigError(
            f"{file} is of Camtrap DP {version}, whose observations have other columns: bring the"
            f" package to one of {', '.join(KNOWN_VERSIONS)} first (camtrapdp in R does)"
        )
    paths = [one.path for one in package.resources if one.name == "media"]
    path = paths[0] if paths else "media.csv"
    if not isinstance(path, str) or "://" in path:
        raise DatasetFormatError(
            f"{file}: the path of its media must be one file of the package, got {path!r}"
        )
    media = _read_media(file.parent / path)
    by_name: dict[str, list[str]] = defaultdict(list)
    for file_path, row in media.items():
        names = {PurePosixPath(file_path).name, row.get("fileName") or ""}
        for name in sorted(names - {""}):
            by_name[name].append(file_path)
    return CamtrapPackage(
        file.parent, version, media, {name: tuple(paths) for name, paths in by_name.items()}
    )


def _read_media(path: Path) -> dict[str, Mapping[str, str]]:
    """FilePath -> row of a media table."""
    if not path.is_file():
        raise DatasetNotFoundError(f"{path} is not there, which the package says holds its media")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            rows, columns = list(reader), reader.fieldnames or ()
    except (UnicodeDecodeError, csv.Error) as error:
        raise DatasetFormatError(f"{path} is no CSV in UTF-8: {error}") from error
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        raise DatasetFormatError(f"{path} lacks the columns {', '.join(missing)} of Camtrap DP")
    media: dict[str, Mapping[str, str]] = {}
    media_ids: set[str] = set()
    for number, row in enumerate(rows, 2):
        own = {"filePath": row["filePath"] in media, "mediaID": row["mediaID"] in media_ids}
        for name, is_known in own.items():
            if is_known and row[name]:
                raise DatasetFormatError(
                    f"{path}, line {number}: {name} {row[name]!r} is that of an earlier line:"
                    " media could not be told apart"
                )
        media_ids.add(row["mediaID"])
        media[row["filePath"]] = row
    return media
