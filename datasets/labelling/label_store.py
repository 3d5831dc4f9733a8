"""From an annotated animal to its label row.

From the cache if it is there, made and stored otherwise.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.labelling.cache import LabelCache
from animal3dbox.datasets.labelling.given_boxes import given_label
from animal3dbox.datasets.labelling.image_index import AnimalHead
from animal3dbox.datasets.labelling.label_records import (
    Given,
    PosePolicy,
    label_records,
    posed_as_stored,
)
from animal3dbox.datasets.labelling.label_rows import LabelRow, label_row
from animal3dbox.datasets.labelling.load_report import Case
from animal3dbox.datasets.labelling.scale import ScaleSource
from animal3dbox.datasets.labelling.sources import ImageSample, Record
from animal3dbox.datasets.records import AnimalRecord, CuboidRecord
from animal3dbox.datasets.storage.fingerprint import (
    code_digest,
    content_digest,
    digest,
    file_digest,
)
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import Rejection

NOT_STORED = "its label could not be stored"
"""How the problem of a case begins that the cache could not take a label."""
_NOTHING_TOLD = PhotoFacts()


class Asked(NamedTuple):
    """An animal whose row is asked for.

    Attributes:
        sample: what is annotated in its image.
        animal: which of the sample's.
        facts: of the image's header.
        key: names what its label is made from, as its files were before anything was decoded; empty
            without a cache.
        mask: (H, W), if it has been decoded; None: decoded when it is needed, if it has one.
    """

    sample: ImageSample
    animal: int
    facts: PhotoFacts
    key: bytes
    mask: NDArray[np.bool_] | None = None

    @property
    def record(self) -> Record:
        """What is said of it."""
        return self.sample.records[self.animal]

    @property
    def bodies(self) -> BodySource:
        """Where its body comes from; raises SampleError if nothing is known of that."""
        if self.sample.bodies is None:
            raise SampleError(
                self.sample.animals[self.animal].sample_id, "body", "there is no source of bodies"
            )
        return self.sample.bodies


class Answer(NamedTuple):
    """What becomes of an animal: its row, rejection or error, and what was wrong with the cache."""

    outcome: LabelRow | Rejection | SampleError
    cases: list[Case]


class _Missing(NamedTuple):
    """An animal that must be labelled.

    Its place among those asked for, and what was wrong with the cache.
    """

    place: int
    asked: Asked
    record: AnimalRecord
    cases: list[Case]


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
        self,
        bodies: bytes,
        config: LabelConfig,
        scale: ScaleSource | None,
        pose: PosePolicy,
        cache: Path | str | None,
        reuse: bool = True,
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
                    f"scale has no name in a cache, for {error}: make it a dataclass of numbers and"
                    " words, or leave out cache"
                ) from error
            made_by = digest(code_digest(), bodies, content_digest(config), scaled, pose.encode())
            self.cache = LabelCache(Path(cache), made_by)

    def asked(self, sample: ImageSample, animal: int, facts: PhotoFacts) -> Asked:
        """An animal to ask for, its mask not decoded yet.

        Raises SampleError if its files cannot be read or it has no body.
        """
        head = sample.animals[animal]
        cached = self.cache is not None and head.vocabulary is not None  # a box is as it comes
        return Asked(sample, animal, facts, _key(head, sample.bodies, facts) if cached else b"")

    def rows(self, asked: Sequence[Asked | SampleError]) -> list[Answer]:
        """What becomes of animals, in order.

        Those that must be labelled are labelled together, and errors stay what they are.
        """
        answers: dict[int, Answer] = {}
        missing: dict[int, list[_Missing]] = {}
        for place, one in enumerate(asked):
            try:
                if isinstance(one, SampleError):
                    raise one
                found, cases = self._kept(one)
                if found is not None:
                    answers[place] = Answer(found, cases)
                elif isinstance(one.record, CuboidRecord):
                    answers[place] = Answer(label_row(given_label(one.record)), cases)
                else:
                    missing.setdefault(id(one.bodies), []).append(
                        _Missing(place, one, one.record, cases)
                    )
            except SampleError as error:
                answers[place] = Answer(error, [])
        for group in missing.values():
            answers |= self._made(group)
        return [answers[place] for place in range(len(asked))]

    def _made(self, group: Sequence[_Missing]) -> dict[int, Answer]:
        """The answers, by place, to animals with one source of bodies that the cache does not hold."""
        given = [
            Given(posed_as_stored(one.record, self.pose), one.asked.facts, one.asked.mask)
            for one in group
        ]
        answers: dict[int, Answer] = {}
        for one, outcome in zip(
            group, label_records(given, group[0].asked.bodies, self.config, self.scale), strict=True
        ):
            if isinstance(outcome, SampleError):
                answers[one.place] = Answer(outcome, one.cases)
            else:
                made = outcome if isinstance(outcome, Rejection) else label_row(outcome)
                answers[one.place] = Answer(made, [*one.cases, *self._store(one.asked, made)])
        return answers

    def fill(self, samples: Sequence[tuple[ImageSample, PhotoFacts]]) -> list[Case]:
        """Store the rows of all animals of some samples, labelled together.

        What could not be, and why.
        """
        names: list[str] = []
        asked: list[Asked | SampleError] = []
        for sample, facts in samples:
            for animal, head in enumerate(sample.animals):
                if head.vocabulary is None:
                    continue  # a box is as it comes
                names.append(head.sample_id)
                try:
                    asked.append(self.asked(sample, animal, facts))
                except SampleError as error:
                    asked.append(error)
        cases = []
        for name, answer in zip(names, self.rows(asked), strict=True):
            cases += answer.cases
            if isinstance(answer.outcome, SampleError):
                cases.append(fault_case(answer.outcome))
            elif isinstance(answer.outcome, Rejection):
                cases.append(rejected_case(name, answer.outcome))
        return cases

    def _kept(self, asked: Asked) -> tuple[LabelRow | Rejection | None, list[Case]]:
        """What the cache holds of an animal, and what is wrong with the cache."""
        head = asked.sample.animals[asked.animal]
        if self.cache is None or not asked.key:
            return None, []
        cases = self._cases(self.cache, head.sample_id)
        found, damaged = self.cache.get(asked.key) if self.reuse else (None, False)
        if damaged:
            cases.append(
                _cache_case(
                    head.sample_id,
                    (
                        "its label was damaged and is made anew"
                        if found is None
                        else "one copy of its label is damaged"
                    ),
                )
            )
        return found, cases

    def _store(self, asked: Asked, made: LabelRow | Rejection) -> list[Case]:
        """Put a row into the cache, if there is one; the case that it could not be."""
        if self.cache is None:
            return []
        name = asked.sample.animals[asked.animal].sample_id
        try:
            if (
                self.asked(asked.sample, asked.animal, asked.facts).key == asked.key
            ):  # else a file was replaced meanwhile: which one was decoded?
                self.cache.put(asked.key, made)
        except SampleError:  # or has vanished
            return []
        except OSError as error:
            return [
                _cache_case(
                    name, f"{NOT_STORED} ({error}): it is used, and made anew the next time"
                )
            ]
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
    return Case(
        kind="fault",
        sample_id=error.sample_id or "sample",
        field=error.field,
        problem=error.problem,
    )


def rejected_case(sample_id: str, rejection: Rejection) -> Case:
    """The case of an animal without a label."""
    return Case(
        kind="rejected", sample_id=sample_id, field=rejection.reason, problem=rejection.detail
    )


def _key(head: AnimalHead, bodies: BodySource | None, facts: PhotoFacts) -> bytes:
    """What the label is computed from, besides what the cache's fingerprint names."""
    body = b"" if bodies is None or bodies.lasting else bodies.content(head.sample_id)
    try:
        mask = file_digest(head.mask_path) if head.mask_path else b""
    except OSError as error:
        raise SampleError(
            head.sample_id, "mask", f"{head.mask_path} cannot be read: {error}"
        ) from error
    return digest(
        head.content, body, mask, b"" if facts == _NOTHING_TOLD else content_digest(facts)
    )


def _cache_case(sample_id: str, problem: str) -> Case:
    return Case(kind="cache", sample_id=sample_id, field="cache", problem=problem)
