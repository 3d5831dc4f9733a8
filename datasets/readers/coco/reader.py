"""The reader of COCO keypoints: images of animals with named keypoints, boxes and masks.

AP-10K, AnimalPose and what is converted to them are read alike.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import msgspec

from animal3dbox.datasets.images.photos import is_file
from animal3dbox.datasets.images.picture_folder import PictureFolder
from animal3dbox.datasets.readers.coco.animal import AnimalReading, with_confidence
from animal3dbox.datasets.readers.coco.file import (
    Category,
    CocoFile,
    ImageName,
    coco_file,
    species_by_id,
    wanted_species,
)
from animal3dbox.datasets.readers.coco.indexed_animals import (
    IndexedAnimals,
    IndexedFile,
    IndexHeader,
    index_bytes,
)
from animal3dbox.datasets.readers.coco.notes import coco_notes
from animal3dbox.datasets.readers.coco.opening import (
    CocoRanges,
    OpenedCoco,
    opened_coco,
    opened_plainly,
)
from animal3dbox.datasets.readers.distinct_animals import elsewhere_notes
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import RecordSet
from animal3dbox.datasets.storage.array_bytes import StoredArrays
from animal3dbox.datasets.storage.fingerprint import content_digest, digest
from animal3dbox.datasets.storage.index_folder import IndexFolder
from animal3dbox.datasets.storage.json_files import read_json_bytes
from animal3dbox.datasets.storage.json_ranges import FileState, RangeReader, file_state
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

FORMAT = "coco"
"""The format's name in reports and for --format."""
FILES = ("annotations.json", "keypoints.json")
"""Names of the file in a folder that is given as the dataset; keypoints.json is AnimalPose's."""
_LAYOUT = b"coco index 1"
"""Changed with what an index holds."""


def find_coco(path: Path) -> Path:
    """The annotation file of a dataset given by its folder or by that file.

    Raises DatasetNotFoundError unless the folder holds exactly one of FILES.
    """
    if path.is_file():
        return path
    candidates = [path / name for name in FILES if (path / name).is_file()]
    if len(candidates) != 1:
        raise DatasetNotFoundError(
            f"{path} must hold exactly one of {', '.join(FILES)}: give the file itself (one of"
            " annotations/*.json in AP-10K)"
        )
    return candidates[0]


def read_coco(
    path: Path,
    images: Path | None = None,
    vocabulary: Vocabulary | None = None,
    *,
    tolerance: Tolerance | None = None,
    categories: Sequence[str] = (),
    check_paths: bool = True,
    index_folder: Path | None = None,
) -> RecordSet:
    """The animals of a COCO keypoints file, or of AnimalPose's json.

    Args:
        path: the file, or the folder it lies in.
        images: the folder that file_name is relative to; None: the first of the usual ones that has
            the first image.
        vocabulary: what the keypoints are, by their names; None: the known vocabulary that fits
            the categories' names.
        tolerance: how bad masks and boxes, and scores, are taken; None: not at all.
        categories: names of those that are read; none: all whose keypoints are an animal's.
        check_paths: whether every picture is looked up now, and a missing one is a fault; else
            pictures are looked up when they are read, and the records are made when they are asked
            for (RecordsOnDemand).
        index_folder: of indexes, which spare later openings most of the reading; used without
            check_paths.

    Returns:
        The records, those of an image together, in the order of "images", and a fault for each that
        is unusable.

    Raises:
        DatasetNotFoundError: no such file, or no such folder of images.
        DatasetFormatError: not JSON, or not COCO's.
        ConfigError: no category has keypoints that are known.

    """
    reading = CocoReading(
        find_coco(path), images, vocabulary, tolerance or Tolerance(), tuple(categories)
    )
    return reading.every_record() if check_paths else reading.on_demand(index_folder)


@dataclass(frozen=True)
class CocoReading:
    """One annotation file and the options that it is read with, as read_coco has them.

    Attributes:
        file: the annotation file.
        images: the folder of pictures; None: a usual one.
        vocabulary: the user's own; None: by the categories' names.
        tolerance: how bad parts are taken.
        categories: names of those that are read; none: all of animals.
    """

    file: Path
    images: Path | None
    vocabulary: Vocabulary | None
    tolerance: Tolerance
    categories: tuple[str, ...]

    @property
    def digest(self) -> bytes:
        """Names all that an index depends on besides the file and the installed code."""
        words = b"" if self.vocabulary is None else content_digest(self.vocabulary)
        options = (self.tolerance.optional, self.tolerance.visibility, self.tolerance.upright)
        return digest(_LAYOUT, words, content_digest(options), content_digest(self.categories))

    def has_index(self, folder: Path) -> bool:
        """Whether there is an index of the file, which then is COCO's."""
        try:
            return IndexFolder(folder).has(IndexFolder(folder).key(self.file, self.digest))
        except OSError:
            return False

    def every_record(self) -> RecordSet:
        """The dataset with every annotation decoded and every picture looked up."""
        content = CocoContent(self, checks=True)
        opened = opened_plainly(content.ranges, content.reading, content.read)
        records = tuple(animal.record for animal in opened.plain.animals)
        if self.tolerance.visibility == "flags":
            graded = opened.counts.graded > 0
            records = tuple(with_confidence(record, graded) for record in records)
        return RecordSet(
            name=FORMAT,
            records=records,
            faults=opened.plain.faults,
            notes=content.notes(opened, elsewhere_notes(records)),
            categories=content.listed,
        )

    def on_demand(self, index_folder: Path | None) -> RecordSet:
        """The dataset by its index, which is made if there is none."""
        state, note = file_state(self.file), ""
        folder = None if index_folder is None else IndexFolder(index_folder)
        if folder is None:
            index = StoredArrays(self._index()[0])
        else:
            index, note = self._stored_index(folder)
        return self._by_index(index, state, note)

    def _stored_index(self, folder: IndexFolder) -> tuple[StoredArrays, str]:
        """The index in a folder, made and stored if it is not there, and a note on that or ""."""
        key, note = folder.key(self.file, self.digest), ""
        try:
            index = folder.load(key)
            if index is not None:
                return index, ""
        except DatasetFormatError as error:
            note = f"{error}: the index of {self.file.name} has been made anew"
        content, is_lasting = self._index()
        if not is_lasting:
            return StoredArrays(content), (
                f"no index of {self.file.name} is kept, since some of its names or sizes have to be"
                " looked up among the pictures: every opening reads all annotations"
            )
        try:
            return folder.save(key, content), note
        except OSError as error:
            return StoredArrays(content), f"no index of {self.file.name} can be kept: {error}"

    def _index(self) -> tuple[bytes, bool]:
        """The index of the file, and whether it holds whatever becomes of the pictures."""
        content = CocoContent(self, checks=False)
        opened = opened_coco(content.ranges, content.reading, content.read)
        header = IndexHeader(
            categories=content.categories,
            first_image=content.first_image,
            listed=[*content.listed],
            used=sorted(opened.categories),
            faults=[(one.sample_id, one.field, one.problem) for one in opened.plain.faults],
            notes=[*content.notes(opened)],
            with_place=opened.with_place,
            graded=opened.counts.graded > 0,
            has_corners=content.reading.has_corners,
        )
        index = index_bytes(header, opened, content.ranges, skipped=content.skipped)
        return index, not content.reading.pictures.was_asked

    def _by_index(self, index: StoredArrays, state: FileState, note: str) -> RecordSet:
        """The dataset of an index.

        Where its pictures are not where their names say, all are looked up after all: only together
        do they tell whether each is the right one.
        """
        header = msgspec.msgpack.decode(index.header, type=IndexHeader)
        root = self.images or images_root(self.file, header.first_image)
        _check_folder(root)
        tolerance = replace(self.tolerance, left_out=[], minus_ones=[])
        reader = RangeReader(self.file, state)
        file = IndexedFile(index, reader, root, self.vocabulary, tolerance)
        animals = IndexedAnimals(file)
        if PictureFolder(root).is_elsewhere(animals.some_names()):
            return replace(self, tolerance=tolerance).every_record()
        return RecordSet(
            name=FORMAT,
            records=animals,
            faults=tuple(SampleError(*fault) for fault in header.faults),
            notes=(*header.notes, *filter(None, [note])),
            categories=tuple(header.listed),
        )


class CocoContent:
    """The content of an annotation file, undecoded, and how it is to be read.

    Args:
        options: the file, and how the user wants it read.
        checks: whether every picture is looked up.

    """

    def __init__(self, options: CocoReading, *, checks: bool) -> None:
        data = read_json_bytes(options.file)
        file = coco_file(data, options.file)
        self.skipped = options.file.stat().st_size - len(data)
        self.categories: list[Category] = file.categories
        self._species = species_by_id(file.categories, options.vocabulary)
        self.first_image = _first_image(file)
        root = options.images or images_root(options.file, self.first_image)
        _check_folder(root)
        self.read = wanted_species(self._species, options.categories)
        self.reading = AnimalReading(
            self._species,
            PictureFolder(root, checks=checks),
            options.tolerance,
            has_corners=isinstance(file.images, dict),
        )
        self.ranges = CocoRanges.of(data, file)

    @cached_property
    def listed(self) -> tuple[str, ...]:
        """The names of the categories that are read, in the file's order."""
        return tuple(kind.name for kind in self._species.values() if kind.name in self.read)

    def notes(self, opened: OpenedCoco, elsewhere: Iterable[str] = ()) -> tuple[str, ...]:
        """What a careful person should know of the file, in whole sentences."""
        tolerance = self.reading.tolerance
        return (
            *coco_notes(
                opened.counts,
                (kind for kind in self._species.values() if kind.name in self.read),
                has_flags=tolerance.visibility == "flags",
            ),
            *elsewhere,
            *tolerance.notes(),
        )


def _first_image(file: CocoFile) -> str | None:
    """The name of a file's first image that has one."""
    if isinstance(file.images, dict):
        return next(iter(file.images.values()), None)
    for raw in file.images:
        try:
            return msgspec.json.decode(raw, type=ImageName).file_name
        except (msgspec.DecodeError, UnicodeDecodeError):
            continue
    return None


def images_root(annotations: Path, first_image: str | None) -> Path:
    """The folder of images: the first of the usual ones that holds the first image.

    Without such a folder it is images/ beside the annotations, or else their own folder.
    """
    home = annotations.parent
    folders = (home / "images", home, home.parent / "images", home.parent / "data", home.parent)
    with_image = (one for one in folders if first_image and is_file(one / first_image))
    return next(with_image, folders[0] if folders[0].is_dir() else home)


def _check_folder(root: Path) -> None:
    """Raise a DatasetNotFoundError unless there is a folder of images."""
    if not root.is_dir():
        raise DatasetNotFoundError(f"there is no folder of images {root}")
