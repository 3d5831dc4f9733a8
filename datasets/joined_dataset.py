"""Several Datasets as one, whose classes are merged by name."""

import bisect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate

import torch
from torch import Tensor
from torch.utils.data import Dataset

from animal3dbox.datasets.batches import collate
from animal3dbox.datasets.images.remote_files import picture_path
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.dataset_options import SampleIndex
from animal3dbox.datasets.labelling.load_report import Case, LoadReport
from animal3dbox.datasets.labelling.skipped import Sample, Skipped, Target
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.datasets.sightings import Sighting
from animal3dbox.errors import ConfigError, SampleError


class JoinedDataset(Dataset[tuple[Tensor, Target] | Skipped]):
    """Several Datasets in a row, each with its own options, cache and transform, as one.

    Classes of the same name are one class, and labels are numbered anew; ``meta["source"]`` of a
    target says which Dataset it is from, ``meta["sample_key"]`` its epoch and place here. Lengths
    stay in the units of each; scale_known says which are metres.

    Args:
        datasets: by the names of the sources.
        same: what classes are called here, by their names in the Datasets, where two names mean
            one class: ``{"Canis familiaris": "dog"}``.
        classes: the order of the merged classes, all of them or more; None: as they are met first.

    Attributes:
        classes: the merged classes.
        notes: those of the Datasets, with their sources' names.
        collate_fn: what a DataLoader needs, see LabelDataset.

    Raises:
        ConfigError: no Dataset, or one that is no LabelDataset, such as a Subset; a name in
            ``same`` that no Dataset has, or one that is renamed and another's new name too; or a
            merged class that ``classes`` lacks.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> one, two = (SyntheticDataset(2, seed=seed, image_hw=(60, 80)) for seed in (0, 1))
        >>> joined = JoinedDataset({"one": one, "two": two}, same={"lion": "cat"})
        >>> len(joined), "lion" in joined.classes, joined[3][1]["meta"]["source"]
        (4, False, 'two')
    """

    collate_fn = staticmethod(collate)

    def __init__(
        self,
        datasets: Mapping[str, LabelDataset],
        *,
        same: Mapping[str, str] | None = None,
        classes: Sequence[str] | None = None,
    ) -> None:
        if not isinstance(datasets, Mapping) or not datasets:
            raise ConfigError(
                "datasets must be Datasets by the names of their sources, {'zoo': dataset, ...},"
                f" got {datasets!r}"
            )
        for name, one in datasets.items():
            if not isinstance(one, LabelDataset):
                raise ConfigError(
                    f"{name} is a {type(one).__name__}, but only LabelDatasets can be joined: for"
                    " a part of one, join the whole and take torch's Subset of the result"
                )
        self.names, self.datasets = tuple(datasets), tuple(datasets.values())
        self.classes, self._numbers = _merged(self.datasets, same or {}, classes)
        self._ends = [*accumulate(map(len, self.datasets))]
        self.notes = tuple(
            f"{name}: {note}" for name, one in datasets.items() for note in one.notes
        )

    def __len__(self) -> int:
        return self._ends[-1]

    def __repr__(self) -> str:
        parts = (f"{name}: {len(one)}" for name, one in zip(self.names, self.datasets, strict=True))
        return (
            f"JoinedDataset\n    Number of images: {len(self)} ({', '.join(parts)})"
            f"\n    Classes: {', '.join(self.classes)}"
        )

    @property
    def epoch(self) -> int:
        """The epoch whose random draws samples get."""
        return self.datasets[0].epoch

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of all, see LabelDataset.set_epoch."""
        for dataset in self.datasets:
            dataset.set_epoch(epoch)

    def own_epoch(self) -> None:
        """Part the epochs of all from those of other processes, see LabelDataset.own_epoch."""
        for dataset in self.datasets:
            dataset.own_epoch()

    def report(self) -> LoadReport:
        """What has been left out so far and why, source by source."""
        return LoadReport(tuple(case for one in self.datasets for case in one.report().cases))

    def image_id(self, index: int) -> str:
        """The name of a sample's image in its own Dataset."""
        source, place = self._place(index)
        return self.datasets[source].image_id(place)

    def warm(self, indices: Sequence[int]) -> tuple[Case, ...]:
        """Store the labels of some samples in their Datasets' caches, see LabelDataset.warm."""
        cases: list[Case] = []
        for source, dataset in enumerate(self.datasets):
            places = [place for one, place in map(self._place, indices) if one == source]
            cases += dataset.warm(places) if places else ()
        return tuple(cases)

    def __getitem__(self, index: SampleIndex) -> tuple[Tensor, Target] | Skipped:
        return self.__getitems__([index])[0]

    def __getitems__(self, indices: Sequence[SampleIndex]) -> list[tuple[Tensor, Target] | Skipped]:
        """The samples of a batch; those of one Dataset are labelled together."""
        places = [self._place(one[1] if isinstance(one, tuple) else one) for one in indices]
        samples: dict[int, tuple[Tensor, Target] | Skipped] = {}
        for source, dataset in enumerate(self.datasets):
            own = [number for number, (one, _) in enumerate(places) if one == source]
            own_indices: list[SampleIndex] = []
            for number in own:
                index = indices[number]
                place = places[number][1]
                own_indices.append((index[0], place) if isinstance(index, tuple) else place)
            for number, sample in zip(own, dataset.__getitems__(own_indices), strict=True):
                samples[number] = self._renumbered(sample, source)
        return [samples[number] for number in range(len(indices))]

    def _place(self, index: int) -> tuple[int, int]:
        """The Dataset that an index leads to, and the place there; raises IndexError."""
        count = len(self)
        if not -count <= index < count:
            raise IndexError(f"index {index} of {count} images")
        source = bisect.bisect_right(self._ends, index % count)
        return source, index % count - self._ends[source] + len(self.datasets[source])

    def _renumbered(
        self, sample: tuple[Tensor, Target] | Skipped, source: int
    ) -> tuple[Tensor, Target] | Skipped:
        first = self._ends[source] - len(self.datasets[source])
        if isinstance(sample, Skipped):
            return replace(sample, index=first + sample.index)
        image, target = sample
        epoch, place = target["meta"]["sample_key"]
        meta = {"source": self.names[source], "sample_key": (epoch, first + place)}
        numbers = self._numbers[source].to(target["labels"].device)
        return Sample(
            (image, {**target, "labels": numbers[target["labels"]], "meta": target["meta"] | meta})
        )

    def cuboids(self) -> CuboidSet:
        """The boxes of all samples, for the exporters: write_omni3d, write_coco, write_kitti.

        Names of images and boxes begin with their sources', which keeps them apart. What a Dataset
        left out is among the faults if something is wrong with it.

        Raises:
            ConfigError: a Dataset has a transform: its boxes would not be those of its files.

        """
        for name, dataset in zip(self.names, self.datasets, strict=True):
            if dataset.transform is not None:
                raise ConfigError(f"{name} has a transform: its boxes are not those of its files")
        images: list[CuboidImage] = []
        records: list[CuboidRecord] = []
        lenses: list[SampleError] = []
        for index in range(len(self)):
            sample = self[index]
            if isinstance(sample, Skipped):
                continue
            image = self._cuboid_image(index, sample)
            if "distortion" in sample[1]:
                problem = "is a lens, which no exchange format has: straighten the image"
                lenses.append(SampleError(image.image_id, "distortion", problem))
                continue
            images.append(image)
            records += _records(image, sample[1], self.classes)
        faults = [
            SampleError(case.sample_id, case.field, case.problem)
            for case in self.report().of("fault")
        ]
        return CuboidSet(
            "joined",
            tuple(records),
            (*faults, *lenses),
            self.notes,
            images=tuple(images),
            categories=self.classes,
        )

    def _cuboid_image(self, index: int, sample: tuple[Tensor, Target]) -> CuboidImage:
        image, target = sample
        source, place = self._place(index)
        path = self.datasets[source].source.sample(place).image_path
        return CuboidImage(
            image_id=f"{self.names[source]}/{target['image_id']}",
            image_path=picture_path(path),
            image_hw=(image.shape[-2], image.shape[-1]),
            K=target["K"].double().numpy(),
            upright=target["meta"]["turned_upright"],
        )


def _merged(
    datasets: Sequence[LabelDataset], same: Mapping[str, str], classes: Sequence[str] | None
) -> tuple[tuple[str, ...], list[Tensor]]:
    """The merged classes, and for each Dataset the merged number of each of its own."""
    every = dict.fromkeys(name for dataset in datasets for name in dataset.classes)
    unknown = [name for name in same if name not in every]
    if unknown:
        raise ConfigError(f"same names {unknown}, which no Dataset has: they have {[*every]}")
    chained = [name for name, new in same.items() if new != name and same.get(new, new) != new]
    if chained:
        raise ConfigError(
            f"same calls {chained[0]!r} {same[chained[0]]!r}, which it calls"
            f" {same[same[chained[0]]]!r}: give each name the one that it shall have at the end"
        )
    needed = dict.fromkeys(same.get(name, name) for name in every)
    merged = tuple(needed if classes is None else classes)
    numbers = {name: number for number, name in enumerate(merged)}
    missing = [name for name in needed if name not in numbers]
    if missing or len(numbers) != len(merged):
        raise ConfigError(f"classes must differ and hold {missing or [*needed]}, got {merged}")
    return merged, [
        torch.tensor([numbers[same.get(name, name)] for name in one.classes], dtype=torch.int64)
        for one in datasets
    ]


def _records(image: CuboidImage, target: Target, classes: Sequence[str]) -> Iterator[CuboidRecord]:
    """The boxes of a target as records."""
    for animal, label in enumerate(target["labels"].tolist()):
        center, rotation, size, box = (
            target[name][animal].double().numpy()
            for name in ("center", "rotation", "size", "boxes")
        )
        yield CuboidRecord(
            sample_id=image.image_id + (f"#{animal}" if animal else ""),
            image_id=image.image_id,
            image_path=image.image_path,
            image_hw=image.image_hw,
            category=classes[label],
            K=image.K,
            center=center,
            rotation=rotation,
            size=size,
            metric=bool(target["scale_known"][animal]),
            heading_known="face_visible" in target,
            box=box if (box[2:] > box[:2]).all() else None,
            truncation=float(target["truncation"][animal]),
            sighting=Sighting(**target["meta"]["sightings"][animal]),
            upright=image.upright,
        )
