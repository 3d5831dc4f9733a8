"""Which files of a mesh folder belong together, told by their names."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from animal3dbox.datasets.bodies.mesh_formats import MESH_SUFFIXES
from animal3dbox.datasets.images.photos import IMAGE_SUFFIXES
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError

COMMON_CAMERA = "camera.json"
EXTRAS = {"keypoints": ".json", "masks": ".png", "cameras": ".json"}
"""The folders of what an animal or image may have besides its mesh, and what their files' names end
with."""
_NUMBERED = re.compile(r"(?P<name>.+)(?P<number>[._]\d+)")


@dataclass(frozen=True)
class AnimalFiles:
    """The files of one animal in one image, relative to the folder, or None where it has none.

    Attributes:
        sample_id: the image, and "#k" for the animals after the first.
        image: relative to the folder of images.
        mesh: relative to the folder, like the others.
        camera: of the image.
        keypoints: of the animal.
        mask: of the animal.
    """

    sample_id: str
    image: str
    mesh: str
    camera: str | None
    keypoints: str | None
    mask: str | None


@dataclass
class Listing:
    """What was found.

    Attributes:
        animals: those of an image together, images in the order of their names.
        faults: meshes without an image, and files that have one name.
        notes: what nothing was made of, counted, in whole sentences.
    """

    animals: list[AnimalFiles] = field(default_factory=list)
    faults: list[SampleError] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Files:
    """The files by name: path without suffix -> path, each relative to its own folder.

    Attributes:
        images: of the folder of images.
        meshes: of meshes/.
        numbered: name -> meshes NAME_0, NAME_1, ... with their numbers.
        extras: likewise of keypoints/, masks/ and cameras/.
        has_common_camera: whether there is a camera.json.
    """

    images: dict[str, str]
    meshes: dict[str, str]
    numbered: dict[str, list[tuple[str, str]]]
    extras: dict[str, dict[str, str]]
    has_common_camera: bool

    def of_image(self, name: str) -> list[AnimalFiles]:
        """The animals of an image.

        Its own meshes, or those that its camera's folder shares with others.
        """
        ends = (self._meshes(end) for end in _ends(name))
        found = next((meshes for meshes in ends if meshes), [])
        return [self._animal(name, k, *mesh, alone=len(found) == 1) for k, mesh in enumerate(found)]

    def _meshes(self, name: str) -> list[tuple[str, str]]:
        """The meshes of a name, with "" or their number."""
        return ([(name, "")] if name in self.meshes else []) + self.numbered.get(name, [])

    def _animal(self, name: str, k: int, mesh: str, number: str, alone: bool) -> AnimalFiles:
        own = (
            (name + number, name) if alone else (name + number,)
        )  # the only animal's files may have the image's name
        return AnimalFiles(
            sample_id=self.images[name] + (f"#{k}" if k else ""),
            image=self.images[name],
            mesh=f"meshes/{self.meshes[mesh]}",
            camera=self._extra("cameras", _camera_places(name))
            or (COMMON_CAMERA if self.has_common_camera else None),
            keypoints=self._extra("keypoints", own),
            mask=self._extra("masks", own),
        )

    def _extra(self, kind: str, names: Iterable[str]) -> str | None:
        """The first of these names that there is."""
        files = self.extras[kind]
        return next((f"{kind}/{files[name]}" for name in names if name in files), None)


def list_mesh_folder(root: Path, images: Path) -> Listing:
    """The animals of a folder by the names of its files, see docs/formats.md.

    Raises:
        DatasetNotFoundError: there are no folders of images and meshes.
        DatasetFormatError: there is no mesh.

    """
    for folder in (images, root / "meshes"):
        if not folder.is_dir():
            raise DatasetNotFoundError(
                f"there is no folder {folder}: a mesh folder has images/ and meshes/ (see"
                " docs/formats.md)"
            )
    found = Listing()
    files = _list_files(root, images, found)
    if not files.meshes:
        raise DatasetFormatError(
            f"{root / 'meshes'} holds no mesh ({', '.join((*MESH_SUFFIXES, '.npz'))})"
        )
    for name in sorted(files.images):
        found.animals += files.of_image(name)
    with_mesh = {animal.image for animal in found.animals}
    bare = len(files.images) - len(with_mesh)
    if bare:
        found.notes.append(f"{bare} of {len(files.images)} images have no mesh")
    used = {
        path
        for animal in found.animals
        for path in (animal.mesh, animal.camera, animal.keypoints, animal.mask)
    }
    for name, path in sorted(files.meshes.items()):
        if f"meshes/{path}" not in used:
            found.faults.append(
                SampleError(
                    f"meshes/{path}",
                    "image",
                    f"there is no image {name}.* in {images} that it is of",
                )
            )
    for kind, there in files.extras.items():
        found.notes += _counted(
            sorted(path for path in there.values() if f"{kind}/{path}" not in used),
            f"in {kind}/ belong to no animal",
        )
        found.notes += _counted(
            _of_other_kind(root / kind, EXTRAS[kind]), f"in {kind}/ are no {EXTRAS[kind]}"
        )
    return found


def _list_files(root: Path, images: Path, found: Listing) -> _Files:
    pictures = _by_name(images, IMAGE_SUFFIXES, "image", found)
    meshes = _by_name(root / "meshes", (*MESH_SUFFIXES, ".npz"), "mesh", found)
    extras = {
        kind: _by_name(root / kind, (suffix,), kind, found) for kind, suffix in EXTRAS.items()
    }
    numbered = _numbered(meshes, {end for name in pictures for end in _ends(name)})
    return _Files(pictures, meshes, numbered, extras, (root / COMMON_CAMERA).is_file())


def _counted(files: list[str], what: str) -> Iterable[str]:
    """A sentence on files that nothing was made of."""
    if files:
        yield (
            f"{len(files)} files {what} and are not used:"
            f" {', '.join(files[:3])}{', ...' if len(files) > 3 else ''}"
        )


def _of_other_kind(folder: Path, suffix: str) -> list[str]:
    """The files of a folder, which may be missing, that do not end so; hidden ones are nobody's."""
    files = (
        (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
        if folder.is_dir()
        else ()
    )
    return sorted(
        path.relative_to(folder).as_posix() for path in files if path.suffix.lower() != suffix
    )


def _by_name(
    folder: Path, suffixes: tuple[str, ...], field_name: str, found: Listing
) -> dict[str, str]:
    """Path without suffix -> path, both relative to the folder, which may be missing.

    Of two of one name the first.
    """
    names: dict[str, str] = {}
    for path in sorted(folder.rglob("*")) if folder.is_dir() else []:
        if path.suffix.lower() not in suffixes:
            continue
        relative = path.relative_to(folder)
        name = relative.with_suffix("").as_posix()
        if name in names:
            found.faults.append(
                SampleError(
                    relative.as_posix(),
                    field_name,
                    f"has the name of {names[name]}: keep one of them",
                )
            )
        else:
            names[name] = relative.as_posix()
    return names


def _ends(name: str) -> list[str]:
    """A name, and what is left of it without its first folders.

    Cameras that see one mesh have folders of their own.
    """
    parts = name.split("/")
    return ["/".join(parts[i:]) for i in range(len(parts))]


def _camera_places(name: str) -> list[str]:
    """The image's own camera, then those of its folders, the innermost first."""
    parts = name.split("/")
    return ["/".join(parts[:i]) for i in range(len(parts), 0, -1)]


def _numbered(meshes: Iterable[str], images: set[str]) -> dict[str, list[tuple[str, str]]]:
    """Name -> meshes NAME_0, NAME_1, ... or NAME.0, ...

    With their numbers, in order; what is an image's own name is not taken apart.
    """
    groups: dict[str, list[tuple[str, str]]] = {}
    for mesh in meshes:
        match = _NUMBERED.fullmatch(mesh)
        if match and mesh not in images:
            groups.setdefault(match["name"], []).append((mesh, match["number"]))
    return {
        name: sorted(group, key=lambda pair: int(pair[1][1:])) for name, group in groups.items()
    }
