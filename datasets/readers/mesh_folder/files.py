"""The files of a mesh folder that belong together, as their names tell.

The naming rules are those of docs/formats.md: a mesh has its image's name, perhaps with a number
for each of several animals, or is shared by the images of several cameras' folders.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from animal3dbox.datasets.bodies.mesh_formats import MESH_SUFFIXES
from animal3dbox.datasets.images.named_files import near_miss
from animal3dbox.datasets.images.photos import IMAGE_SUFFIXES
from animal3dbox.datasets.readers.mesh_folder.regressor_names import Rank, own_name
from animal3dbox.datasets.readers.mesh_folder.spellings import NUMBERED, Spellings
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError

COMMON_CAMERA = "camera.json"
"""The camera of all images that have none of their own."""
EXTRAS = {"keypoints": (".json", ".npy"), "masks": (".png",), "cameras": (".json",)}
"""Folders of further files of an animal or image, and the suffixes of the files in each."""


@dataclass(frozen=True)
class AnimalFiles:
    """The paths of the files of one animal in one image.

    Attributes:
        sample_id: the image, and "#k" for the animals after the first.
        image: relative to the folder of images.
        mesh: relative to the mesh folder, like the following.
        camera: the image's camera; None without.
        keypoints: the animal's keypoints; None without.
        mask: the animal's mask; None without.
    """

    sample_id: str
    image: str
    mesh: str
    camera: str | None
    keypoints: str | None
    mask: str | None


@dataclass
class Listing:
    """The animals of a mesh folder by the names of its files.

    Attributes:
        animals: those of an image together, images in the order of their names.
        faults: one error a mesh without an image, and a file whose name another one has.
        notes: numbers of files that are not used, in whole sentences.
    """

    animals: list[AnimalFiles] = field(default_factory=list)
    faults: list[SampleError] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Files:
    """The files of a mesh folder by name, which is the path without suffix in their own folder.

    Attributes:
        images: name -> path in the folder of images.
        meshes: name -> path in meshes/, but for those that may be of either of two images.
        numbered: name -> meshes NAME_0, NAME_1, ... with their numbers.
        extras: folder -> name -> path, of keypoints/, masks/ and cameras/.
        has_common_camera: whether there is a camera.json.
    """

    images: dict[str, str]
    meshes: dict[str, str]
    numbered: dict[str, list[tuple[str, str]]]
    extras: dict[str, dict[str, str]]
    has_common_camera: bool

    def of_image(self, name: str) -> list[AnimalFiles]:
        """The animals of an image, by its own meshes or those that several cameras share."""
        candidates = (self._meshes(end) for end in _ends(name))
        meshes = next((group for group in candidates if group), [])
        return [
            self._animal(name, k, mesh, alone=len(meshes) == 1) for k, mesh in enumerate(meshes)
        ]

    def _meshes(self, name: str) -> list[tuple[str, str]]:
        """The meshes of a name, each with "" or its number."""
        return ([(name, "")] if name in self.meshes else []) + self.numbered.get(name, [])

    def _animal(
        self, name: str, k: int, numbered_mesh: tuple[str, str], *, alone: bool
    ) -> AnimalFiles:
        """The files of an image's animal k, which may be the only one in it."""
        mesh, number = numbered_mesh
        # The files of an only animal may have the image's name, without its number.
        own = (name + number, name) if alone else (name + number,)
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
        """The first file of these names in a folder of EXTRAS; None if there is none."""
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
                f"there is no folder {folder}: a mesh folder has images/ and meshes/, and the mesh"
                " of images/a.jpg is meshes/a.obj (.ply, .stl, .off, .npz)"
            )
    listing = Listing()
    files = _list_files(root, images, listing)
    if not files.meshes and not listing.faults:
        raise DatasetFormatError(
            f"{root / 'meshes'} holds no mesh ({', '.join((*MESH_SUFFIXES, '.npz'))})"
        )
    for name in sorted(files.images):
        listing.animals += files.of_image(name)
    with_mesh = {animal.image for animal in listing.animals}
    bare = len(files.images) - len(with_mesh)
    if bare:
        listing.notes.append(f"{bare} of {len(files.images)} images have no mesh")
    _note_unused(root, images, files, listing)
    return listing


def _note_unused(root: Path, images: Path, files: _Files, listing: Listing) -> None:
    """Add a fault for each mesh, and notes on other files, that belong to no animal."""
    paths = {
        path
        for animal in listing.animals
        for path in (animal.mesh, animal.camera, animal.keypoints, animal.mask)
    }
    for name, path in sorted(files.meshes.items()):
        if f"meshes/{path}" not in paths:
            listing.faults.append(
                SampleError(
                    f"meshes/{path}",
                    "image",
                    f"there is no image {name}.* in {images} that it is of"
                    f"{_other_names(images, files.images, name)}",
                )
            )
    for kind, by_name in files.extras.items():
        listing.notes += _unused_note(
            sorted(path for path in by_name.values() if f"{kind}/{path}" not in paths),
            f"in {kind}/ belong to no animal",
        )
        listing.notes += _unused_note(
            _of_other_kind(root / kind, EXTRAS[kind]),
            f"in {kind}/ are no {' or '.join(EXTRAS[kind])}",
        )


def _other_names(folder: Path, images: Mapping[str, str], name: str) -> str:
    """Words that name the images that a mesh without one may be of; "" if none is near."""
    alike = Spellings(images).alike(name)
    if len(alike) > 1:
        return f"; it may be of {' or '.join(images[one] for one in alike)}: name it as the one"
    return near_miss(folder, f"{name}.jpg")


def _list_files(root: Path, images: Path, listing: Listing) -> _Files:
    """The files of a mesh folder by name; those of a name that another has are faults."""
    pictures = _by_name(images, IMAGE_SUFFIXES, "image", listing)
    ends = {end for name in pictures for end in _ends(name)}
    places = {place for name in pictures for place in _camera_places(name)}
    spellings = Spellings(ends)
    meshes = _by_name(root / "meshes", (*MESH_SUFFIXES, ".npz"), "mesh", listing, images=spellings)
    of_kind = {"cameras": Spellings(ends | places)}
    extras = {
        kind: _by_name(root / kind, suffixes, kind, listing, images=of_kind.get(kind, spellings))
        for kind, suffixes in EXTRAS.items()
    }
    _take_out_ambiguous(meshes, pictures, listing)
    numbered = _numbered(meshes, ends)
    return _Files(
        images=pictures,
        meshes=meshes,
        numbered=numbered,
        extras=extras,
        has_common_camera=(root / COMMON_CAMERA).is_file(),
    )


def _unused_note(files: list[str], reason: str) -> Iterable[str]:
    """A sentence on files that are not used, if there are any."""
    if files:
        yield (
            f"{len(files)} files {reason} and are not used:"
            f" {', '.join(files[:3])}{', ...' if len(files) > 3 else ''}"
        )


def _of_other_kind(folder: Path, suffixes: tuple[str, ...]) -> list[str]:
    """The files of a folder, which may be missing, of other suffixes; hidden ones do not count."""
    files = (
        (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
        if folder.is_dir()
        else ()
    )
    return sorted(
        path.relative_to(folder).as_posix() for path in files if path.suffix.lower() not in suffixes
    )


def _by_name(
    folder: Path,
    suffixes: tuple[str, ...],
    field_name: str,
    listing: Listing,
    *,
    images: Spellings | None = None,
) -> dict[str, str]:
    """Path without suffix -> path, both relative to the folder, which may be missing.

    What regressors add to a name is no part of it, unless an image has it, too; of a mesh before
    and after their adaptation it is the one after. Of two other files of one name it is the first;
    the second is a fault of the listing.

    Args:
        folder: may be missing.
        suffixes: of the files.
        field_name: what they are, for errors.
        listing: gets the faults.
        images: the names of images, with and without their first folders, which these files have
            in any letter case and Unicode form; None: these are images.

    """
    names: dict[str, str] = {}
    ranks: dict[str, Rank] = {}
    replaced: list[str] = []
    for relative in _files_of(folder, suffixes, images):
        plain = relative.with_suffix("").as_posix()
        as_is = images is None or len(images.alike(plain)) == 1
        name, rank = (plain, Rank.PLAIN) if as_is else own_name(plain)
        name = name if images is None else images.own_spelling(name)
        if name in names and rank != ranks[name]:
            replaced.append(names[name] if rank < ranks[name] else relative.as_posix())
            if rank < ranks[name]:
                names[name], ranks[name] = relative.as_posix(), rank
        elif name in names:
            listing.faults.append(
                SampleError(
                    relative.as_posix(),
                    field_name,
                    f"has the name of {names[name]}: keep one of them",
                )
            )
        else:
            names[name], ranks[name] = relative.as_posix(), rank
    listing.notes += _unused_note(replaced, f"of {folder.name}/ have a better one beside them")
    return names


def _files_of(folder: Path, suffixes: tuple[str, ...], images: Spellings | None) -> list[Path]:
    """The files of some suffixes below a folder, which may be missing, relative to it.

    Those that are spelled as an image come first, so that no other one takes their place.
    """
    files = sorted(folder.rglob("*")) if folder.is_dir() else []
    relative = [path.relative_to(folder) for path in files if path.suffix.lower() in suffixes]
    if images is None:
        return relative
    return sorted(relative, key=lambda path: not images.is_exact(path.with_suffix("").as_posix()))


def _ends(name: str) -> list[str]:
    """A name, and the same without its first folder, its first two, and so on.

    Cameras that see one mesh have folders of images of their own, so the mesh has a shorter name.
    """
    parts = name.split("/")
    return ["/".join(parts[i:]) for i in range(len(parts))]


def _camera_places(name: str) -> list[str]:
    """Names of an image's own camera, then of its folders' cameras, the innermost first."""
    parts = name.split("/")
    return ["/".join(parts[:i]) for i in range(len(parts), 0, -1)]


def _take_out_ambiguous(
    meshes: dict[str, str], pictures: Mapping[str, str], listing: Listing
) -> None:
    """Remove each mesh that may be of either of two images, with a fault for every such image.

    Beside dog.jpg and dog_1.jpg, dog_1.obj may be the first's animal of that number, or the other's
    only one. It is the other's if dog.jpg has a mesh of its very name, and neither has numbered
    ones besides: then each image has the mesh that is called like it, which a note says.
    """
    by_end: dict[str, list[str]] = {}
    for name in sorted(pictures):
        for end in _ends(name):
            by_end.setdefault(end, []).append(name)
    numbered = _numbered(meshes, set(by_end))
    alike: list[str] = []
    ambiguous: list[tuple[str, re.Match[str]]] = []
    for mesh in sorted(meshes):
        match = NUMBERED.fullmatch(mesh)
        if match is None or mesh not in by_end or match["name"] not in by_end:
            continue
        first = match["name"]
        is_plain = first in meshes and not numbered.get(first) and not numbered.get(mesh)
        if is_plain:
            alike.append(mesh)
        else:
            ambiguous.append((mesh, match))
    for mesh, match in ambiguous:
        path, number = meshes.pop(mesh), int(match["number"][1:])
        one, other = by_end[match["name"]], by_end[mesh]
        problem = _either(path, pictures[one[0]], pictures[other[0]], match)
        samples = [pictures[name] + (f"#{number}" if number else "") for name in one]
        samples += [pictures[name] for name in other]
        listing.faults += [SampleError(sample, "mesh", problem) for sample in samples]
    if alike:
        listing.notes.append(
            f"{len(alike)} meshes are called like an image, and like a second animal of another"
            f" one, and are taken for the first: {', '.join(meshes[mesh] for mesh in alike[:3])}"
            f"{', ...' if len(alike) > 3 else ''}"
        )


def _either(path: str, one: str, other: str, match: re.Match[str]) -> str:
    """The problem of a mesh that may be of either of two images, and its remedy."""
    suffix, mark, number = Path(path).suffix, match["number"][0], match["number"][1:]
    other_mark = "." if mark == "_" else "_"
    return (
        f"meshes/{path} may be animal {number} of {one}, or the first of {other}: name it"
        f" {match['name']}{other_mark}{number}{suffix} or {match['name']}{mark}{number}_0{suffix}"
    )


def _numbered(meshes: Iterable[str], images: set[str]) -> dict[str, list[tuple[str, str]]]:
    """Name -> meshes NAME_0, NAME_1, ... or NAME.0, ... with their numbers, in order.

    A mesh that has the name of an image is not taken apart.
    """
    groups: dict[str, list[tuple[str, str]]] = {}
    for mesh in meshes:
        match = NUMBERED.fullmatch(mesh)
        if match and mesh not in images:
            groups.setdefault(match["name"], []).append((mesh, match["number"]))
    return {
        name: sorted(group, key=lambda pair: int(pair[1][1:])) for name, group in groups.items()
    }
