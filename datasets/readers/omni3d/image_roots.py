"""Where the images lie that a file names, when it is only said relative to what."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from animal3dbox.datasets.images.photos import resolve_inside
from animal3dbox.errors import SampleError

TRIED = 20
"""Images that are looked for to find their folder."""


def image_root(annotations: Path, images: Path | None, file_paths: Sequence[str]) -> Path | None:
    """The folder that image paths are relative to.

    The one that is given, else the first near the annotations that holds one of them.

    Args:
        annotations: the annotation file.
        images: what the user says.
        file_paths: as the file names them; the first few are looked for.

    Returns:
        A folder; None if none of them is to be found.

    """
    if images is not None:
        return images
    home = annotations.resolve().parent
    near = (home, home / "images", *list(home.parents)[:2])
    return next(
        (
            root
            for root in near
            if any((root / name).is_file() for name in file_paths[:TRIED] if not _leads_out(name))
        ),
        None,
    )


def image_path(root: Path | None, annotations: Path, file_path: str, sample_id: str) -> Path:
    """The file of an image.

    Checked if there is a root, else as it is named, beside the annotations.

    Raises:
        SampleError: absolute, leading out of the root, or missing in a root where others are.

    """
    if root is not None:
        return resolve_inside(root, file_path, sample_id, "file_path")
    if not file_path or _leads_out(file_path):
        raise SampleError(
            sample_id,
            "file_path",
            f"{file_path!r} leads out of the images' folder: paths must be relative and stay"
            " inside it",
        )
    return annotations.parent / file_path


def _leads_out(file_path: str) -> bool:
    pure = PurePosixPath(file_path)
    return "\0" in file_path or pure.is_absolute() or ".." in pure.parts
