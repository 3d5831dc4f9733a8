"""The folder of an Omni3D file's images, which the file names relative to a folder unsaid."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from animal3dbox.datasets.images.named_files import (
    is_absolute_name,
    portable_name,
    resolve_inside,
)
from animal3dbox.errors import SampleError

TRIED = 20
"""Number of images that are looked for to find their folder."""


def image_root(annotations: Path, images: Path | None, file_paths: Sequence[str]) -> Path | None:
    """The folder that image paths are relative to.

    It is the user's, else the first one near the annotations that holds one of the images, of an
    absolute path of another machine as much as leads to one.

    Args:
        annotations: the annotation file.
        images: the user's folder; None: look for one.
        file_paths: the images, as the file names them; the first TRIED are looked for.

    Returns:
        A folder; None if none of the images is to be found.

    """
    if images is not None:
        return images
    home = annotations.resolve().parent
    names = [name for name in file_paths[:TRIED] if not _leads_out(name)]
    for root in (home, home / "images", *list(home.parents)[:2]):
        if any((root / name).is_file() for name in names):
            return root
    absolute = [name for name in file_paths[:TRIED] if is_absolute_name(name)]
    for root in (home / "images", home):
        if any(portable_name(root, name) != name for name in absolute):
            return root
    return None


def image_path(root: Path | None, annotations: Path, file_path: str, sample_id: str) -> Path:
    """The path of an image file: checked under a root, else as it is named beside the annotations.

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
            " inside it, or lead to an image of the folder that is given (--images)",
        )
    return annotations.parent / file_path


def _leads_out(file_path: str) -> bool:
    """Whether a path is absolute, goes up through "..", or is no path at all."""
    parts = PurePosixPath(file_path.replace("\\", "/")).parts
    return "\0" in file_path or is_absolute_name(file_path) or ".." in parts
