"""The animals of a dataset whose annotations are decoded when somebody asks for them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

from animal3dbox.datasets.images.remote_files import PicturePath
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

Change = Callable[[AnimalRecord], AnimalRecord]


@dataclass(frozen=True)
class RecordSummary:
    """What is known of all animals without decoding any.

    Attributes:
        categories: those that any animal has.
        vocabularies: those that any animal's keypoints have.
        with_place: how many animals' places the file says.
    """

    categories: frozenset[str]
    vocabularies: tuple[Vocabulary, ...]
    with_place: int


class RecordsOnDemand(Sequence[AnimalRecord], ABC):
    """The animals of a dataset in the order of its images, each made anew when it is asked for.

    None of them has a camera of its own, and none a pose. Where pictures lie is looked up when one
    is read: an animal's image_path is where its name says, be there a file or not.
    """

    @property
    @abstractmethod
    def summary(self) -> RecordSummary:
        """What is known of all animals."""

    @property
    @abstractmethod
    def image_count(self) -> int:
        """How many images have animals."""

    @abstractmethod
    def image_name(self, image: int) -> str:
        """The name of an image, by its number."""

    @abstractmethod
    def members(self, image: int) -> range:
        """The places of an image's animals among all."""

    @abstractmethod
    def records_of(self, image: int) -> tuple[AnimalRecord, ...]:
        """The animals of an image, at least one."""

    @abstractmethod
    def record(self, place: int) -> AnimalRecord:
        """The animal at a place."""

    @abstractmethod
    def picture(self, name: str) -> PicturePath:
        """The file or URL of an image's picture; raises SampleError unless there is just one."""

    @abstractmethod
    def changed(self, change: Change) -> Self:
        """The same animals, each as a function makes it of what the file says."""

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        count = len(self)
        if not -count <= index < count:
            raise IndexError(f"index {index} of {count}")
        return self.record(index % count)
