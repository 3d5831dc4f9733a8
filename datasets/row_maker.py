"""From an annotated animal to its label row: from the cache if it is there, made and stored otherwise."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.cache import LabelCache
from animal3dbox.datasets.exif import PhotoFacts
from animal3dbox.datasets.fingerprint import code_digest, content_digest, digest, file_digest
from animal3dbox.datasets.given_boxes import given_label
from animal3dbox.datasets.heads import AnimalHead
from animal3dbox.datasets.label_rows import LabelRow, label_row
from animal3dbox.datasets.labelling import Given, PosePolicy, label_record, label_records, posed_as_stored
from animal3dbox.datasets.ledger import Case
from animal3dbox.datasets.records import AnimalRecord, CuboidRecord
from animal3dbox.datasets.scale import ScaleSource
from animal3dbox.datasets.sources import ImageSample
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import Rejection

NOT_STORED = "its label could not be stored"
"""How the problem of a case begins that the cache could not take a label."""
_NOTHING_TOLD = PhotoFacts()


class RowMaker:
    """Makes the rows of one dataset under one method.

    Args:
        bodies: names the content of its bodies.
        config: the method.
        scale: what makes labels metric, or None.
        pose: what a stored camera is taken for.
        cache: folder of the label cache, or None.
        reuse: whether what is in the cache is used.

    """

    def __init__(
        self, bodies: bytes, config: LabelConfig, scale: ScaleSource | None, pose: PosePolicy, cache: Path | str | None, reuse: bool = True
    ) -> None:
        if pose not in ("hypothesis", "exact"):
            raise ConfigError(f"pose must be 'hypothesis' or 'exact', got {pose!r}")
        self.config, self.scale, self.pose, self.reuse = config, scale, pose, reuse
        self.cache: LabelCache | None = None
        self._told: set[str] = set()
        if cache is not None:
            try:
                scaled = content_digest(scale)
            except TypeError as error:
                raise ConfigError(
                    f"scale has no name in a cache, for {error}: make it a dataclass of numbers and words, or leave out cache"
                ) from error
            made_by = digest(code_digest(), bodies, content_digest(config), scaled, pose.encode())
            self.cache = LabelCache(Path(cache), made_by)

    def row(self, sample: ImageSample, animal: int, facts: PhotoFacts, mask: NDArray[np.bool_] | None) -> tuple[LabelRow | Rejection, list[Case]]:
        """An animal's row or rejection, and what was wrong with the cache.

        Raises:
            SampleError: the animal's record is unusable.

        """
        key, found, cases = self._kept(sample, animal, facts)
        if found is not None:
            return found, cases
        record = sample.records[animal]
        if isinstance(record, CuboidRecord):
            return label_row(given_label(record)), []
        outcome = label_record(posed_as_stored(record, self.pose), _bodies_of(sample, record), self.config, facts, self.scale, mask)
        made = outcome if isinstance(outcome, Rejection) else label_row(outcome)
        return made, [*cases, *self._store(record, key, made)]

    def fill(self, samples: Sequence[tuple[ImageSample, PhotoFacts]]) -> list[Case]:
        """Store the rows of all animals of some samples that share their source of bodies, labelled together; what could not be, and why."""
        missing, cases = self._missing(samples)
        if not missing:
            return cases
        bodies = _bodies_of(samples[0][0], missing[0][0].record)
        for (given, key), outcome in zip(missing, label_records([one for one, _ in missing], bodies, self.config, self.scale), strict=True):
            if isinstance(outcome, SampleError):
                cases.append(fault_case(outcome))
                continue
            if isinstance(outcome, Rejection):
                cases.append(rejected_case(given.record.sample_id, outcome))
            cases += self._store(given.record, key, outcome if isinstance(outcome, Rejection) else label_row(outcome))
        return cases

    def _missing(self, samples: Sequence[tuple[ImageSample, PhotoFacts]]) -> tuple[list[tuple[Given, bytes]], list[Case]]:
        """The animals that the cache does not hold, with their keys, and cases of the others."""
        missing: list[tuple[Given, bytes]] = []
        cases: list[Case] = []
        for sample, facts in samples:
            for animal, record in enumerate(sample.records):
                if isinstance(record, CuboidRecord):
                    continue
                try:
                    key, found, told = self._kept(sample, animal, facts)
                except SampleError as error:
                    cases.append(fault_case(error))
                    continue
                cases += told
                if found is None:
                    missing.append((Given(posed_as_stored(record, self.pose), facts), key))
                elif isinstance(found, Rejection):
                    cases.append(rejected_case(record.sample_id, found))
        return missing, cases

    def _kept(self, sample: ImageSample, animal: int, facts: PhotoFacts) -> tuple[bytes, LabelRow | Rejection | None, list[Case]]:
        """The key of an animal, what the cache holds under it, and what is wrong with the cache."""
        head = sample.animals[animal]
        if self.cache is None or head.vocabulary is None:  # a box is as it comes
            return b"", None, []
        key, cases = _key(head, sample.bodies, facts), self._cases(self.cache, head.sample_id)
        found, damaged = self.cache.get(key) if self.reuse else (None, False)
        if damaged:
            cases.append(
                _cache_case(head.sample_id, "its label was damaged and is made anew" if found is None else "one copy of its label is damaged")
            )
        return key, found, cases

    def _store(self, record: AnimalRecord, key: bytes, made: LabelRow | Rejection) -> list[Case]:
        """Put a row into the cache, if there is one; the case that it could not be."""
        if self.cache is None:
            return []
        try:
            self.cache.put(key, made)
        except OSError as error:
            return [_cache_case(record.sample_id, f"{NOT_STORED} ({error}): it is used, and made anew the next time")]
        return []

    def _cases(self, cache: LabelCache, sample_id: str) -> list[Case]:
        """What is wrong with the cache's files, each told once."""
        problems = cache.problems()
        if not problems:
            return []
        new = [problem for problem in problems if problem not in self._told]
        self._told.update(new)
        return [_cache_case(sample_id, problem) for problem in new]


def fault_case(error: SampleError) -> Case:
    """The case of an unusable sample."""
    return Case(kind="fault", sample_id=error.sample_id or "sample", field=error.field, problem=error.problem)


def rejected_case(sample_id: str, rejection: Rejection) -> Case:
    """The case of an animal without a label."""
    return Case(kind="rejected", sample_id=sample_id, field=rejection.reason, problem=rejection.detail)


def _bodies_of(sample: ImageSample, record: AnimalRecord) -> BodySource:
    if sample.bodies is None:
        raise SampleError(record.sample_id, "body", "there is no source of bodies")
    return sample.bodies


def _key(head: AnimalHead, bodies: BodySource | None, facts: PhotoFacts) -> bytes:
    """What the label is computed from, besides what the cache's fingerprint names."""
    body = b"" if bodies is None or bodies.lasting else bodies.content(head.sample_id)
    try:
        mask = file_digest(head.mask_path) if head.mask_path else b""
    except OSError as error:
        raise SampleError(head.sample_id, "mask", f"{head.mask_path} cannot be read: {error}") from error
    return digest(head.content, body, mask, b"" if facts == _NOTHING_TOLD else content_digest(facts))


def _cache_case(sample_id: str, problem: str) -> Case:
    return Case(kind="cache", sample_id=sample_id, field="cache", problem=problem)
