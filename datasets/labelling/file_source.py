"""A dataset in files as samples: its annotations by image, its pictures read when asked for."""

from collections.abc import Iterable

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import Photo, checked_facts, read_photo
from animal3dbox.datasets.labelling.image_samples import ImageSample, Record
from animal3dbox.datasets.labelling.record_stores import PackedRecords, RecordStore, StoredRecords
from animal3dbox.datasets.records import CuboidRecord, CuboidSet, RecordSet
from animal3dbox.datasets.storage.records_on_demand import RecordsOnDemand
from animal3dbox.errors import ConfigError, SampleError


class FileSource:
    """A dataset in files: its annotations packed, or read from their file when asked for.

    Args:
        records: animals with the source of their bodies, or boxes that come as they are.
        bodies: needed for animals.

    Example:
        >>> from animal3dbox.datasets import FileSource, LabelDataset, SyntheticSet, preset_body
        >>> source = FileSource(SyntheticSet(seed=0, images=2).records(), preset_body("dog"))
        >>> len(LabelDataset(source))
        2
    """

    def __init__(self, records: RecordSet | CuboidSet, bodies: BodySource | None = None) -> None:
        _check_bodies(records, bodies)
        self.name, self.faults, self.notes = records.name, records.faults, records.notes
        self.bodies = bodies
        unread = frozenset(
            name for fault in self.faults for name in images_of(fault.sample_id or "")
        )
        animals = records.records
        self._store: RecordStore
        if isinstance(animals, RecordsOnDemand):
            self.named_faces, self.has_cameras = True, False
            used: Iterable[str] = animals.summary.categories
            self._store = StoredRecords(animals, bodies, unread)
        else:
            self.named_faces = all(getattr(record, "heading_known", True) for record in animals)
            self.has_cameras = any(has_camera(record) for record in animals)
            used = {record.category for record in animals}
            self._store = PackedRecords(records, bodies, unread)
        listed = dict.fromkeys(records.categories)
        self.categories = (*listed, *sorted(set(used).difference(listed)))

    def __len__(self) -> int:
        return len(self._store)

    @property
    def fingerprint(self) -> bytes:
        """Names the content of the bodies."""
        return b"" if self.bodies is None else self.bodies.fingerprint

    def image_id(self, index: int) -> str:
        """The image's name."""
        return self._store.image_id(index)

    def animals(self, index: int) -> int:
        """How many records an image has."""
        return self._store.animals(index)

    def sample(self, index: int) -> ImageSample:
        """What is said of an image; its records are made anew when they are asked for."""
        return self._store.sample(index)

    def photo(self, sample: ImageSample) -> Photo:
        """The image file, which must be as large as its annotations say."""
        path = self._store.picture(sample)
        if path is None:
            raise SampleError(
                sample.image_id,
                "image",
                "is only in memory: give a source that has its pictures, or write the dataset"
                " first",
            )
        return read_photo(path, sample.image_id, sample.image_hw, upright=sample.upright)

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """The facts of the image file's header; none are known without a file."""
        path = self._store.picture(sample)
        if path is None:
            return PhotoFacts()
        return checked_facts(path, sample.image_id, sample.image_hw, upright=sample.upright)


def _check_bodies(records: RecordSet | CuboidSet, bodies: BodySource | None) -> None:
    """Raise a ConfigError unless animals come with a whole source of bodies."""
    if isinstance(records, RecordSet) and bodies is None:
        raise ConfigError(
            f"a dataset of animals ({records.name}) needs a source of their bodies, such as"
            " preset_body('dog')"
        )
    needed = ("fingerprint", "lasting", "content", "body")
    missing = [] if bodies is None else [name for name in needed if not hasattr(bodies, name)]
    if missing:
        raise ConfigError(
            f"{type(bodies).__name__} is no source of bodies: it lacks {', '.join(missing)} (see"
            " datasets.bodies.sources.BodySource)"
        )


def has_camera(record: Record) -> bool:
    """Whether a record comes with its camera's pose, stored or known; a box always does."""
    return (
        isinstance(record, CuboidRecord)
        or record.pose is not None
        or record.stored_pose is not None
    )


def images_of(sample_id: str) -> tuple[str, ...]:
    """The images that a sample may be of: the one of its name, and of "a.jpg#1" also a.jpg.

    A file's name may hold a # itself.
    """
    name, mark, number = sample_id.rpartition("#")
    return (sample_id, name) if mark and number.isdecimal() else (sample_id,)
