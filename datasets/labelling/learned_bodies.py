"""Learning keypoints' places and classes' shapes from records, the fits kept in files meanwhile."""

import io
import zipfile
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.remote_files import PicturePath
from animal3dbox.datasets.labelling.image_samples import sample_of_record
from animal3dbox.datasets.labelling.keypoint_places import keypoints_problem
from animal3dbox.datasets.labelling.label_records import fit_arguments
from animal3dbox.datasets.labelling.label_requests import LabelRequest, facts_of_record
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.fingerprint import code_digest, content_digest, digest
from animal3dbox.errors import SampleError
from animal3dbox.files import write_whole
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.learning.found_fits import FoundFits
from animal3dbox.labels.fit.learning.rounds import (
    LEAST_OF_CLASS,
    LEAST_TAUGHT,
    fits_of_batch,
    learn_bodies,
    work_of,
)
from animal3dbox.labels.fit.request import fit_request, without_points

Watch = Callable[[int, int], None]
Usable = dict[str, list[tuple[AnimalRecord, PhotoFacts]]]
SUFFIX = ".fits.npz"
"""Of the files with the fits of a batch."""


class FittedAnimals(Sequence[Mapping[str, Any]]):
    """fit_animal's arguments of records, made when they are asked for: masks need memory.

    Args:
        records: the animals, as many as there are facts.
        facts: of their pictures' headers.
        bodies: what is fitted to them.
    """

    def __init__(
        self, records: Sequence[AnimalRecord], facts: Sequence[PhotoFacts], bodies: FittedBodies
    ) -> None:
        self.records, self.facts, self.bodies = records, facts, bodies

    def __len__(self) -> int:
        return len(self.records)

    @overload
    def __getitem__(self, index: int) -> Mapping[str, Any]: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Mapping[str, Any]]: ...
    def __getitem__(self, index: int | slice) -> Mapping[str, Any] | Sequence[Mapping[str, Any]]:
        if isinstance(index, slice):
            return FittedAnimals(self.records[index], self.facts[index], self.bodies)
        record = self.records[index]
        request = LabelRequest(sample_of_record(record, self.bodies), 0, self.facts[index])
        arguments = fit_arguments(request, record, self.bodies)
        model = arguments.pop("template")
        return {**arguments, "model": model}


@dataclass(frozen=True)
class LearnedBodies:
    """What a dataset's 2D taught, and from whom.

    Attributes:
        calibration: places and shapes.
        used: vocabulary -> animals that taught.
        few: vocabulary -> animals, of those of which there are too few.
        small_classes: (vocabulary, category, animals) of classes without a shape of their own.
        left_out: animals with too few keypoints, or a lens.
        faults: of animals that could not be read.
    """

    calibration: Calibration
    used: Mapping[str, int]
    few: Mapping[str, int]
    small_classes: tuple[tuple[str, str, int], ...]
    left_out: int
    faults: tuple[SampleError, ...]


def learn_from_records(
    records: Sequence[AnimalRecord],
    bodies: FittedBodies,
    config: LabelConfig,
    *,
    learn: Sequence[str],
    folder: Path,
    watch: Watch | None = None,
) -> LearnedBodies:
    """Learn from the animals of a dataset, of each vocabulary by itself.

    The order of the records does not matter. Fits are kept in a folder as they are made, so that
    learning that was interrupted goes on from there; remove_fits clears it when what was learned is
    safe.

    Args:
        records: the animals.
        bodies: what is fitted to them.
        config: the method.
        learn: "places", "shapes" or both.
        folder: for the fits.
        watch: told how much has been done, and of how much.

    """
    usable, left_out, faults = _usable(records, bodies, config)
    used = {name: len(group) for name, group in usable.items() if len(group) >= LEAST_TAUGHT}
    few = {name: len(group) for name, group in usable.items() if name not in used}
    total, done, parts = sum(work_of(n) for n in used.values()), 0, []

    def advance(count: int) -> None:
        nonlocal done
        done += count
        if watch is not None:
            watch(done, total)

    store = FitStore(folder)
    for name in sorted(used):
        group = usable[name]
        animals = FittedAnimals([record for record, _ in group], [f for _, f in group], bodies)
        fit_batch = partial(store.fits, bodies=bodies)
        parts.append(
            learn_bodies(
                animals,
                config,
                places="places" in learn,
                shapes="shapes" in learn,
                fit_batch=fit_batch,
                watch=advance,
            )
        )
    return LearnedBodies(
        calibration=Calibration(
            places=tuple(one for part in parts for one in part.places),
            shapes=tuple(one for part in parts for one in part.shapes),
        ),
        used=used,
        few=few,
        small_classes=_small_classes(usable, used) if "shapes" in learn else (),
        left_out=left_out,
        faults=faults,
    )


def _usable(
    records: Sequence[AnimalRecord], bodies: FittedBodies, config: LabelConfig
) -> tuple[Usable, int, tuple[SampleError, ...]]:
    """The animals that a body can be fitted to, by vocabulary and in the order of their names."""
    usable: Usable = defaultdict(list)
    left_out, faults = 0, []
    headers: dict[PicturePath, PhotoFacts | SampleError] = {}
    for record in sorted(records, key=lambda one: (one.sample_id, one.image_id)):
        if not bodies.can_fit(record):
            left_out += 1
            continue
        try:
            facts = _facts(record, headers)
            request = fit_request(config=config, **FittedAnimals([record], [facts], bodies)[0])
            if problem := keypoints_problem(record, record.mask):
                raise SampleError(record.sample_id, "keypoints_2d", problem)
        except SampleError as error:
            faults.append(error)
            continue
        if without_points(request, config) is not None:
            left_out += 1
            continue
        usable[record.vocabulary.name].append((record, facts))
    return usable, left_out, tuple(faults)


def _facts(
    record: AnimalRecord, headers: dict[PicturePath, PhotoFacts | SampleError]
) -> PhotoFacts:
    """The facts of the header of an animal's picture, of which each is read once.

    Args:
        record: the animal.
        headers: the facts that were read, or why they cannot be; is extended.

    Raises:
        SampleError: see facts_of_record.

    """
    path = record.image_path
    if path is None:
        return facts_of_record(record)
    if path not in headers:
        try:
            headers[path] = facts_of_record(record)
        except SampleError as error:
            headers[path] = error
    facts = headers[path]
    if isinstance(facts, SampleError):
        raise SampleError(record.sample_id, facts.field, facts.problem)
    return facts


def _small_classes(usable: Usable, used: Mapping[str, int]) -> tuple[tuple[str, str, int], ...]:
    """Vocabulary, category and number of animals of classes that are too small."""
    return tuple(
        (name, category, count)
        for name in sorted(used)
        for category, count in sorted(
            Counter(record.category or "" for record, _ in usable[name]).items()
        )
        if count < LEAST_OF_CLASS or not category
    )


class FitStore:
    """Fits of batches of animals in files, each under a name made of all that it follows from.

    Args:
        folder: of the files.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self._code = folder, code_digest()

    def fits(
        self,
        animals: Sequence[Mapping[str, Any]],
        config: LabelConfig,
        calibration: Calibration,
        *,
        bodies: FittedBodies,
    ) -> FoundFits:
        """The fits of some animals: from their file if there is one, made and stored otherwise."""
        own = [content_digest({k: v for k, v in one.items() if k != "model"}) for one in animals]
        key = digest(
            self._code,
            bodies.fingerprint,
            content_digest(config),
            calibration.digest.encode(),
            *own,
        )
        path = self.folder / f"{key.hex()}{SUFFIX}"
        stored = _stored_fits(path)
        if stored is not None and len(stored) == len(animals):
            return stored
        fits = fits_of_batch(animals, config, calibration)
        buffer = io.BytesIO()
        np.savez(buffer, **{name: getattr(fits, name) for name in FoundFits.__dataclass_fields__})
        write_whole(path, buffer.getvalue())
        return fits


def remove_fits(folder: Path) -> None:
    """Remove all files of fits in a folder, and the folder if nothing else is in it."""
    if not folder.is_dir():
        return
    for path in folder.glob(f"*{SUFFIX}"):
        path.unlink()
    if not any(folder.iterdir()):
        folder.rmdir()


def _stored_fits(path: Path) -> FoundFits | None:
    """The fits of a file; None if there is none, or it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return FoundFits(*(arrays[name] for name in FoundFits.__dataclass_fields__))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
