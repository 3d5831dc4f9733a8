"""The shared Dataset: annotated images in, images and targets out, labels made on the way."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.utils.data import Dataset, get_worker_info

from animal3dbox.datasets.batches import collate
from animal3dbox.datasets.images.photos import Photo
from animal3dbox.datasets.labelling.animal_outcomes import AnimalOutcome, animal_outcomes
from animal3dbox.datasets.labelling.calibrate import dataset_calibration
from animal3dbox.datasets.labelling.dataset_options import (
    OnBad,
    Options,
    Partial,
    SampleIndex,
    TransformCall,
    check_choices,
    default_config,
    first_fault,
    sample_key,
)
from animal3dbox.datasets.labelling.file_source import images_of
from animal3dbox.datasets.labelling.filters import LabelFilter
from animal3dbox.datasets.labelling.image_samples import SampleSource
from animal3dbox.datasets.labelling.image_targets import (
    chosen_labels,
    image_target,
    partial_case,
)
from animal3dbox.datasets.labelling.keypoint_places import Misplaced
from animal3dbox.datasets.labelling.label_records import CameraPolicy, check_camera_policy
from animal3dbox.datasets.labelling.label_store import LabelStore, fault_case
from animal3dbox.datasets.labelling.load_report import Case, CaseFile, LoadReport
from animal3dbox.datasets.labelling.open_samples import OpenSample, mask_of, open_samples
from animal3dbox.datasets.labelling.sample_checks import Outcome
from animal3dbox.datasets.labelling.scale import ScaleSource
from animal3dbox.datasets.labelling.skipped import (
    Sample,
    Skipped,
    Target,
    refuse_unknown,
)
from animal3dbox.datasets.labelling.targets import empty_target, image_tensor
from animal3dbox.datasets.labelling.threads import one_thread
from animal3dbox.datasets.readers.tolerance import BadParts
from animal3dbox.datasets.storage.fingerprint import content_digest, digest
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig


class LabelDataset(Dataset[tuple[Tensor, Target] | Skipped]):
    """Images with the cuboids of their animals, labelled when they are asked for.

    ``dataset[i]`` is ``(image, target)``: the image (3, H, W) uint8 RGB, the target a plain dict as
    docs/datasets.md lists it, float32, with N animals. ``dataset[epoch, i]`` is the same sample as
    epoch's transform draws it.

    Args:
        source: of the samples, see the Datasets named after formats.
        config: how labels are made; None: default_config(stored_cameras, filters).
        on_bad: what to do with an animal that cannot be labelled: "error" raises, "skip" leaves it
            out and writes it down (report()); an image of which no animal is left comes back as
            Skipped.
        partial: whether an image of which only some animals have labels is kept: "keep", or "skip"
            to leave it out, since it shows animals that its target does not name.
        filters: labels that miss them are left out in the same way, and never raise.
        classes: names of the labels' numbers; None: the categories as the dataset lists them,
            whether an animal has them or not, else sorted. An animal of another category is a
            fault.
        transform: ``transform(image, target) -> (image, target)``, such as
            animal3dbox.transforms.Compose.
        scale: what makes labels metric (scale.py); None: only what the dataset itself says.
        stored_cameras: whether a camera that a dataset stores for its bodies is one "hypothesis"
            among others, or "exact"; animals without one get theirs estimated all the same.
        misplaced: keypoints beside the frame, the box or the mask are a "fault" or a "flag".
        optional: a bad mask or box is a "fault", or left out: "drop".
        cache: folder of the label cache; None: none.
        masks: whether targets hold masks, of images whose every animal has one. With False none is
            decoded, but where a label has to be made of it; labels are the same either way.
        report_to: file that cases are appended to; None: a temporary one.
        reuse: whether labels in the cache are used; False makes them all anew.
        calibration: what the dataset taught about its keypoints' places (`animal3dbox calibrate`),
            or the file of it; "auto": learned here, of 10 animals or more; None: nothing is.

    Attributes:
        collate_fn: what a DataLoader needs, since images differ in size and number of animals.
        notes: remarks about the dataset and its calibration, in whole sentences.

    Raises:
        ConfigError: an option has a value that it cannot have, or contradicts the dataset.
        SampleError: on_bad is "error" and an annotation cannot be read.
        TypeError: an unknown option; of those that other libraries have, with the word for it here.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> dataset = SyntheticDataset(2, seed=0, image_hw=(120, 160))
        >>> image, target = dataset[0]
        >>> image.shape, target["corners_3d"].shape
        (torch.Size([3, 120, 160]), torch.Size([1, 8, 3]))
    """

    collate_fn = staticmethod(collate)

    def __init__(
        self,
        source: SampleSource,
        *,
        config: LabelConfig | None = None,
        on_bad: OnBad = "error",
        partial: Partial = "keep",
        filters: LabelFilter | None = None,
        classes: Sequence[str] | None = None,
        transform: TransformCall | None = None,
        scale: ScaleSource | None = None,
        stored_cameras: CameraPolicy = "hypothesis",
        misplaced: Misplaced = "fault",
        optional: BadParts = "fault",
        cache: Path | str | None = None,
        masks: bool = True,
        report_to: Path | str | None = None,
        reuse: bool = True,
        calibration: Calibration | Path | str | None = None,
        **unknown: object,
    ) -> None:
        refuse_unknown(type(self), unknown, Options.__annotations__)
        check_choices(on_bad, partial, scale)
        if on_bad == "error" and source.faults:
            raise first_fault(source.faults)
        check_camera_policy(stored_cameras, source.has_cameras or not len(source), source.notes)
        self.source, self.on_bad, self.partial, self.masks = source, on_bad, partial, masks
        self.filters, self.transform = filters or LabelFilter(), transform
        if isinstance(classes, str):
            raise ConfigError(
                f"classes must be several names, got {classes!r}: write [{classes!r}]"
            )
        self.classes = tuple(source.categories if classes is None else classes)
        self._numbers = {name: number for number, name in enumerate(self.classes)}
        if len(self._numbers) != len(self.classes):
            raise ConfigError(f"classes must differ, got {self.classes}")
        self.case_file = CaseFile(report_to)
        config = config or default_config(stored_cameras, self.filters)
        learned, notes = dataset_calibration(calibration, source, config)
        self.notes: tuple[str, ...] = (*source.notes, *notes)
        self._store = LabelStore(
            source.fingerprint,
            config,
            scale=scale,
            stored_cameras=stored_cameras,
            misplaced=misplaced,
            optional=optional,
            cache=cache,
            reuse=reuse,
            calibration=learned,
        )
        self._epoch: Tensor = torch.zeros((), dtype=torch.int64).share_memory_()  # type: ignore[no-untyped-call]
        for fault in source.faults:
            self.case_file.add(fault_case(fault))

    def __repr__(self) -> str:
        facts = {
            "Number of images": len(self),
            "Format": self.source.name,
            "Classes": ", ".join(self.classes[:8]) + (", ..." if len(self.classes) > 8 else ""),
            "Method": f"{self._store.config.method}, stored cameras {self._store.stored_cameras}",
            "Cache": None if self._store.cache is None else self._store.cache.folder,
            "Transform": self.transform,
        }
        lines = [f"{name}: {fact}" for name, fact in facts.items() if fact is not None]
        return "\n    ".join([f"Dataset {type(self).__name__}", *lines])

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        # A copy.deepcopy of it is not shared, and its workers' would stand still.
        self._epoch.share_memory_()  # type: ignore[no-untyped-call]

    def __len__(self) -> int:
        return len(self.source)

    @property
    def epoch(self) -> int:
        """The epoch whose random draws samples get."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch, in running persistent workers too: its number lies in shared memory.

        Call it before the epoch's iteration begins.
        """
        if epoch < 0:
            raise ConfigError(f"epoch must not be negative, got {epoch}")
        self._epoch.fill_(epoch)

    def own_epoch(self) -> None:
        """Part its epoch from that of other processes that the Dataset was sent to.

        Workers that are started from now on share it, those that run already do not.
        """
        self._epoch = self._epoch.clone().share_memory_()  # type: ignore[no-untyped-call]

    def report(self) -> LoadReport:
        """What has been left out so far and why, by all processes."""
        return self.case_file.report()

    def image_id(self, index: int) -> str:
        """The name of a sample's image."""
        return self.source.image_id(index)

    def __getitem__(self, index: SampleIndex) -> tuple[Tensor, Target] | Skipped:
        return self._samples([index])[0]

    def __getitems__(self, indices: Sequence[SampleIndex]) -> list[tuple[Tensor, Target] | Skipped]:
        """The samples of a batch, the same as one by one to the last bit.

        Labels that must be made are made together, which costs less.

        DataLoaders ask for whole batches in this way.
        """
        # A subclass that changes samples changes those of batches too.
        if type(self).__getitem__ is not LabelDataset.__getitem__:
            return [self[index] for index in indices]
        return self._samples(indices)

    def _samples(self, indices: Sequence[SampleIndex]) -> list[tuple[Tensor, Target] | Skipped]:
        keys = [sample_key(index, self.epoch, len(self)) for index in indices]
        with one_thread():
            places = [place for _, place in keys]
            samples = open_samples(
                self.source,
                places,
                classes=self._numbers,
                store=self._store,
                masks=self.masks,
            )
            requests = [
                request
                for sample in samples
                if not isinstance(sample, SampleError)
                for request in sample[2]
            ]
            outcomes, cases = self._store.labels(requests)
            self._note(cases)  # told once: it must not be lost if a sample raises
            remaining = iter(outcomes)
            return [
                self._finished(key, sample, cases, remaining)
                for key, sample in zip(keys, samples, strict=True)
            ]

    def _note(self, cases: Iterable[Case]) -> None:
        for case in cases:
            self.case_file.add(case)

    def _skipped(self, place: int, cases: list[Case]) -> Skipped:
        self._note(cases)
        return Skipped(place, self.image_id(place), tuple(cases))

    def _finished(
        self,
        key: tuple[int, int],
        sample: OpenSample | SampleError,
        cache_cases: Sequence[Case],
        outcomes: Iterator[Outcome],
    ) -> tuple[Tensor, Target] | Skipped:
        """An open sample with its target; of the outcomes, it takes those of its animals."""
        try:
            if isinstance(sample, SampleError):
                raise sample
            own = list(islice(outcomes, len(sample[2])))
            return self._with_target(key, sample, cache_cases, own)
        except SampleError as error:
            if self.on_bad == "error":
                if get_worker_info() is not None:
                    error.note_for_parent()
                raise
            return self._skipped(key[1], [fault_case(error)])

    def _with_target(
        self,
        key: tuple[int, int],
        opened: OpenSample,
        cache_cases: Sequence[Case],
        outcomes: Sequence[Outcome],
    ) -> tuple[Tensor, Target] | Skipped:
        """An image with the target of its labelled animals; raises SampleError."""
        sample, photo, requests = opened
        if sample.listed is not None and sample.has_unread:
            # It shows animals, of which none can be read.
            faults = [
                fault_case(fault)
                for fault in self.source.faults
                if sample.image_id in images_of(fault.sample_id or "")
            ]
            return self._skipped(key[1], faults)
        if sample.listed is not None:
            K, named_faces = sample.listed.K, self.source.named_faces
            empty = empty_target(sample.image_id, K, named_faces=named_faces)
            return self._transformed(photo, empty, key)
        labels, cases = chosen_labels(
            sample, outcomes, filters=self.filters, raise_errors=self.on_bad == "error"
        )
        names = {entry.sample_id for entry in sample.animals}
        cases = [*(case for case in cache_cases if case.sample_id in names), *cases]
        is_partial = len(labels) < len(sample.animals) or sample.has_unread
        if labels and is_partial and self.partial == "skip":
            cases += [partial_case(sample.animals[place].sample_id) for place in labels]
            labels = {}
        if not labels:
            return self._skipped(key[1], cases)
        self._note(cases)
        masks = [mask_of(requests[place]) for place in labels] if self.masks else []
        target = image_target(
            sample,
            labels,
            masks=masks,
            taken=photo.facts.time,
            class_numbers=self._numbers,
            named_faces=self.source.named_faces,
        )
        return self._transformed(photo, target, key)

    def warm(self, indices: Sequence[int]) -> tuple[Case, ...]:
        """Store the labels of some samples in the cache, made together.

        Of their images only the headers and masks are read.

        Returns:
            A case for each animal with a fault or a rejection, and for each problem of the cache.

        """
        outcomes, cases = self._outcomes(indices, pictures=False)
        cases += [one.case for one in outcomes if one.case is not None]
        self._note(cases)
        return tuple(cases)

    def outcomes(self, indices: Sequence[int], *, pictures: bool = False) -> list[AnimalOutcome]:
        """What becomes of every animal of some images: its label, or why it has none.

        Unlike samples, outcomes leave nobody out, and raise no SampleError. Annotations that could
        not be read at all are in ``source.faults``.

        Args:
            indices: of the images, from 0.
            pictures: whether pictures are decoded; else only their headers and masks are read.

        """
        outcomes, cases = self._outcomes(indices, pictures=pictures)
        self._note(cases)
        return outcomes

    def _outcomes(
        self, indices: Sequence[int], *, pictures: bool
    ) -> tuple[list[AnimalOutcome], list[Case]]:
        with one_thread():
            return animal_outcomes(
                self.source,
                self._store,
                indices,
                classes=self._numbers,
                filters=self.filters,
                pictures=pictures,
            )

    @property
    def config(self) -> LabelConfig:
        """How its labels are made."""
        return self._store.config

    @property
    def labels_digest(self) -> str:
        """32 hex digits that name everything that its outcomes depend on, but the animals.

        The code and its libraries, the bodies, the config and all options that labels know.
        """
        parts = content_digest(self.filters), content_digest(self.classes)
        return digest(self._store.fingerprint, *parts).hex()

    def _transformed(
        self, photo: Photo, target: Target, key: tuple[int, int]
    ) -> tuple[Tensor, Target]:
        image = image_tensor(photo.pixels)
        target["meta"] |= {**photo.facts.turn, "sample_key": key}
        if self.transform is None:
            return Sample((image, target))
        try:
            return Sample(self.transform(image, target))
        except SampleError:
            raise
        except Exception as error:
            error.add_note(f"in the transform of image {target['image_id']}")
            raise
