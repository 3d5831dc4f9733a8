"""The labels of one dataset under one method: from the cache if they are there, made otherwise."""

import time
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import get_args

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.labelling.cache import LabelCache
from animal3dbox.datasets.labelling.fit_notice import FitNotice
from animal3dbox.datasets.labelling.image_index import AnimalEntry
from animal3dbox.datasets.labelling.image_samples import ImageSample
from animal3dbox.datasets.labelling.keypoint_places import Misplaced
from animal3dbox.datasets.labelling.label_records import (
    CameraPolicy,
    estimates_focal_lengths,
    label_records,
)
from animal3dbox.datasets.labelling.label_requests import LabelRequest
from animal3dbox.datasets.labelling.load_report import Case
from animal3dbox.datasets.labelling.sample_checks import Outcome
from animal3dbox.datasets.labelling.scale import ScaleSource
from animal3dbox.datasets.readers.tolerance import BadParts
from animal3dbox.datasets.storage.fingerprint import (
    code_digest,
    content_digest,
    digest,
    file_digest,
)
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import user_path
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel, Rejection

NOT_STORED = "its label could not be stored"
"""The beginning of the problem of a case whose label the cache could not store."""
_NO_FACTS = PhotoFacts()


class LabelStore:
    """Gives the labels of one dataset under one method.

    Args:
        bodies: names the content of its bodies.
        config: the method.
        scale: what makes labels metric, or None.
        stored_cameras: what a stored camera pose is taken for.
        misplaced: what keypoints beside their animal are.
        optional: what masks that cannot be used are.
        cache: folder of the label cache, or None.
        reuse: whether stored labels are read; new ones are stored either way.
        calibration: what the dataset taught; it names the cache's folder too.

    Raises:
        ConfigError: an option has a value that it cannot have.

    """

    def __init__(
        self,
        bodies: bytes,
        config: LabelConfig,
        *,
        scale: ScaleSource | None,
        stored_cameras: CameraPolicy,
        misplaced: Misplaced = "fault",
        optional: BadParts = "fault",
        cache: Path | str | None,
        reuse: bool = True,
        calibration: Calibration | None = None,
    ) -> None:
        if stored_cameras not in ("hypothesis", "exact"):
            raise ConfigError(
                f"stored_cameras must be 'hypothesis' or 'exact', got {stored_cameras!r}"
            )
        if misplaced not in get_args(Misplaced):
            raise ConfigError(f"misplaced must be 'fault' or 'flag', got {misplaced!r}")
        if optional not in get_args(BadParts):
            raise ConfigError(f"optional must be 'fault' or 'drop', got {optional!r}")
        self.config, self.scale, self.stored_cameras = config, scale, stored_cameras
        self.misplaced: Misplaced = misplaced
        self.optional: BadParts = optional
        self.reuse, self.calibration = reuse, calibration
        self.cache: LabelCache | None = None
        self._reported: set[str] = set()
        self._fit_notice = FitNotice()
        self._bodies = bodies
        if cache is not None:
            self.cache = LabelCache(user_path(cache), self.fingerprint)

    @cached_property
    def fingerprint(self) -> bytes:
        """16 bytes that name everything that labels depend on, but the animals.

        Raises:
            ConfigError: the scale's content has no name.

        """
        try:
            scale_digest = content_digest(self.scale)
        except TypeError as error:
            raise ConfigError(
                f"scale has no name in a cache or a table, for {error}: make it a dataclass of"
                " numbers and words, or do without"
            ) from error
        return digest(
            code_digest(),
            self._bodies,
            content_digest(self.config),
            scale_digest,
            self.stored_cameras.encode(),
            self.misplaced.encode(),
            self.optional.encode(),
            b"" if self.calibration is None else self.calibration.digest.encode(),
        )

    def request(self, sample: ImageSample, place: int, facts: PhotoFacts) -> LabelRequest:
        """The request for an animal's label, its mask not decoded yet.

        Raises:
            SampleError: with a cache, its mask's file or its own body cannot be read.

        """
        entry = sample.animals[place]
        is_given_box = entry.vocabulary is None  # nothing is estimated, so nothing is stored
        is_cacheable = self.cache is not None and not is_given_box
        key = self._key(sample, place, facts) if is_cacheable else b""
        return LabelRequest(sample, place, facts, key)

    def _key(self, sample: ImageSample, place: int, facts: PhotoFacts) -> bytes:
        """What the label is computed from, besides what the cache's fingerprint names.

        Where a focal length may be estimated, the other animals of the image count, too; those that
        cannot be read tell nothing.
        """
        header = b"" if facts == _NO_FACTS else content_digest(facts)
        parts = [*_content(sample.animals[place], sample.bodies), header]
        if len(sample.animals) > 1 and estimates_focal_lengths(self.config):
            for i, entry in enumerate(sample.animals):
                if i != place and entry.vocabulary is not None:
                    with suppress(SampleError):
                        parts += _content(entry, sample.bodies)
        return digest(*parts)

    def labels(
        self, requests: Sequence[LabelRequest | SampleError]
    ) -> tuple[list[Outcome], list[Case]]:
        """The labels of animals, in order.

        Those that are not in the cache are made together; errors stay what they are.

        Returns:
            The outcomes, and what was wrong with the cache.

        """
        outcomes: dict[int, Outcome] = {}
        cases: list[Case] = []
        missing: dict[int, LabelRequest] = {}
        for place, request in enumerate(requests):
            if isinstance(request, SampleError):
                outcomes[place] = request
                continue
            cached = self._from_cache(request, cases)
            if cached is None:
                missing[place] = request
            else:
                outcomes[place] = cached
        begin = time.perf_counter()
        made = label_records(
            list(missing.values()),
            self.config,
            scale=self.scale,
            stored_cameras=self.stored_cameras,
            calibration=self.calibration,
            misplaced=self.misplaced,
            optional=self.optional,
        )
        self._fit_notice.tell(made, time.perf_counter() - begin)
        for (place, request), outcome in zip(missing.items(), made, strict=True):
            outcomes[place] = outcome
            if not isinstance(outcome, SampleError):
                cases += self._put_into_cache(request, outcome)
        return [outcomes[place] for place in range(len(requests))], cases

    def _from_cache(
        self, request: LabelRequest, cases: list[Case]
    ) -> CuboidLabel | Rejection | None:
        """The label that the cache holds of an animal; what is wrong with the cache joins cases."""
        if self.cache is None or not request.key:
            return None
        name = request.entry.sample_id
        cases += self._new_problems(self.cache, name)
        outcome, is_damaged = self.cache.get(request.key) if self.reuse else (None, False)
        if is_damaged:
            problem = (
                "its label was damaged and is made anew"
                if outcome is None
                else "one copy of its label is damaged"
            )
            cases.append(_cache_case(name, problem))
        return outcome

    def _put_into_cache(
        self, request: LabelRequest, outcome: CuboidLabel | Rejection
    ) -> list[Case]:
        """Store a label, if there is a cache; the case that it could not be."""
        if self.cache is None or not request.key:
            return []
        try:
            # If the key changed meanwhile, nobody knows which file was decoded: store nothing.
            if self.request(request.sample, request.place, request.facts).key == request.key:
                self.cache.put(request.key, outcome)
        except SampleError:  # or has vanished
            return []
        except OSError as error:
            problem = f"{NOT_STORED} ({error}): it is used, and made anew the next time"
            return [_cache_case(request.entry.sample_id, problem)]
        return []

    def _new_problems(self, cache: LabelCache, sample_id: str) -> list[Case]:
        """What is wrong with the cache's files, each told once."""
        problems = cache.problems()
        if not problems:
            return []
        new = [problem for problem in problems if problem not in self._reported]
        self._reported.update(new)
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


def _cache_case(sample_id: str, problem: str) -> Case:
    return Case(kind="cache", sample_id=sample_id, field="cache", problem=problem)


def _content(entry: AnimalEntry, bodies: BodySource | None) -> tuple[bytes, bytes, bytes]:
    """Digests of an animal's annotation, of its own body and of its mask's file."""
    body = b"" if bodies is None or bodies.lasting else bodies.content(entry.sample_id)
    try:
        mask = file_digest(entry.mask_path) if entry.mask_path else b""
    except OSError as error:
        raise SampleError(
            entry.sample_id, "mask", f"{entry.mask_path} cannot be read: {error}"
        ) from error
    return entry.content, body, mask
