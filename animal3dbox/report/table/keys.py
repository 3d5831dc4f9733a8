"""The keys of a table's rows, and which rows are missing: what resuming needs, by any engine.

A key is a digest of the image, the animal, what is said of it, and `LabelDataset.labels_digest`,
which names code, bodies, config and options. It is the same in every process and on every machine.
Keys are taken from the annotations alone, so that asking what is missing reads no picture: that a
picture or mask was replaced since is not noticed.
"""

from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.animal_outcomes import animal_number
from animal3dbox.datasets.labelling.image_index import AnimalEntry
from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.errors import SampleError


def table_length(dataset: LabelDataset) -> int:
    """How many indices a dataset's table has: one an image, and one an unreadable annotation.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> table_length(SyntheticDataset(2, seed=0, image_hw=(120, 160)))
        2
    """
    return len(dataset) + len(dataset.source.faults)


def animal_key(labels_digest: str, image_id: str, number: int, entry: AnimalEntry) -> str:
    """The key of an animal's row, 32 hex digits."""
    name = image_id.encode("utf-8", "surrogatepass")
    return digest(bytes.fromhex(labels_digest), name, str(number).encode(), entry.content).hex()


@dataclass(frozen=True)
class UnreadAnimal:
    """An animal whose annotation cannot be read.

    Attributes:
        index: in the table.
        image_id: its image, if the reader got so far; else the annotation's place in its file.
        number: which of its image's animals it is.
        place: among the dataset's faults.
        fault: what is wrong.
    """

    index: int
    image_id: str
    number: int
    place: int
    fault: SampleError

    def key(self, labels_digest: str) -> str:
        """The key of its row, 32 hex digits; its place parts it from others of the same fault."""
        words = (self.fault.sample_id or "", self.fault.field, self.fault.problem)
        named = (word.encode("utf-8", "surrogatepass") for word in (*words, f"fault {self.place}"))
        return digest(bytes.fromhex(labels_digest), *named).hex()


def unread_animal(dataset: LabelDataset, index: int) -> UnreadAnimal:
    """The unreadable annotation of an index from len(dataset) on."""
    place = index - len(dataset)
    fault = dataset.source.faults[place]
    sample_id = fault.sample_id or "sample"
    name, mark, number = sample_id.rpartition("#")
    is_numbered = bool(mark) and number.isdecimal()
    image_id = name if is_numbered else sample_id
    return UnreadAnimal(index, image_id, int(number) if is_numbered else 0, place, fault)


def row_keys(dataset: LabelDataset, indices: Iterable[int]) -> Iterator[tuple[int, str]]:
    """The index and the key of each row of some indices, in their order."""
    labels_digest, count = dataset.labels_digest, len(dataset)
    for index in indices:
        if index >= count:
            yield index, unread_animal(dataset, index).key(labels_digest)
            continue
        sample = dataset.source.sample(index)
        for place, entry in enumerate(sample.animals):
            number = animal_number(entry.sample_id, sample.image_id, place)
            yield index, animal_key(labels_digest, sample.image_id, number, entry)


def missing_indices(
    dataset: LabelDataset, indices: Iterable[int], known_keys: Container[str]
) -> list[int]:
    """The indices of which a row is not there yet: the anti-join by which any engine resumes.

    Args:
        dataset: whose table it is.
        indices: that are wanted, see label_table.
        known_keys: of the rows that are there.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> dataset = SyntheticDataset(3, seed=0, image_hw=(120, 160))
        >>> missing_indices(dataset, range(3), {key for _, key in row_keys(dataset, [1])})
        [0, 2]
    """
    keys = row_keys(dataset, indices)
    return [*dict.fromkeys(index for index, key in keys if key not in known_keys)]
