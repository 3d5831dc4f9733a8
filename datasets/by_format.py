"""The torch Datasets, one a format: each reads its annotations and leaves the rest to LabelDataset."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, TypedDict, Unpack

from animal3dbox.datasets import animal3d, stanfordextra
from animal3dbox.datasets.bodies import BodySource, ParametersBody
from animal3dbox.datasets.body_options import DEFAULT_BODY, bodies_for, body_source
from animal3dbox.datasets.filters import LabelFilter
from animal3dbox.datasets.label_dataset import LabelDataset, OnBad, TransformCall
from animal3dbox.datasets.reading import ReadOptions, read_dataset
from animal3dbox.datasets.row_maker import PosePolicy
from animal3dbox.datasets.scale import ScaleSource
from animal3dbox.datasets.sources import FileSource
from animal3dbox.datasets.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic_source import SyntheticSource
from animal3dbox.labels.config import LabelConfig
from animal3dbox.smal.vocabularies import vocabulary_of_option
from animal3dbox.smal.vocabulary import Vocabulary


class Options(TypedDict, total=False):
    """LabelDataset's options."""

    config: LabelConfig | None
    on_bad: OnBad
    partial: Literal["keep", "skip"]
    filters: LabelFilter | None
    classes: Sequence[str] | None
    transform: TransformCall | None
    scale: ScaleSource | None
    pose: PosePolicy
    cache: Path | str | None
    masks: bool
    report_to: Path | None


class AnnotatedDataset(LabelDataset):
    """Animals of any format that can be read; the format is recognised, or given.

    Args:
        path: the dataset's folder or annotation file.
        format: of datasets.reading.FORMATS, or "auto".
        images: the folder that image paths are relative to, if not the usual one.
        model: the SMAL file of the dataset's own parameters or meshes.
        vocabulary: what the keypoints are, if their names do not tell: a vocabulary, its name, or a TOML file.
        body: one body for all animals, a preset's name, a model's file or a source; None: the dataset's own, else a dog.
        **options: LabelDataset's.

    """

    def __init__(
        self,
        path: Path | str,
        *,
        format: str = "auto",
        images: Path | str | None = None,
        model: Path | str | None = None,
        vocabulary: str | Vocabulary | None = None,
        body: str | BodySource | None = None,
        **options: Unpack[Options],
    ) -> None:
        folder, file = (None if p is None else Path(p) for p in (images, model))
        words = vocabulary_of_option(vocabulary) if isinstance(vocabulary, str) else vocabulary
        read = read_dataset(Path(path), format, ReadOptions(folder, file, words))
        own = body_source(body) if isinstance(body, str) else body
        bodies = bodies_for(read, own)
        super().__init__(FileSource(read.records, bodies.packed() if isinstance(bodies, ParametersBody) else bodies), **options)


class Animal3DDataset(AnnotatedDataset):
    """Animal3D, its 2D-only relatives and what is written like it.

    Args:
        path: the folder, or one of its json files.
        model: the SMAL file of its parameters; without it all animals get ``body``.
        images: the folder that img_path is relative to; None: the json's.
        body: one body for all animals instead of their own.
        **options: LabelDataset's.

    """

    def __init__(
        self,
        path: Path | str,
        model: Path | str | None = None,
        *,
        images: Path | str | None = None,
        body: str | BodySource | None = None,
        **options: Unpack[Options],
    ) -> None:
        super().__init__(path, format=animal3d.FORMAT, images=images, model=model, body=body, **options)


class StanfordExtraDataset(AnnotatedDataset):
    """StanfordExtra: dogs.

    Args:
        path: the json, or the folder it lies in.
        images: the folder that img_path is relative to.
        body: of all animals.
        **options: LabelDataset's.

    """

    def __init__(
        self, path: Path | str, *, images: Path | str | None = None, body: str | BodySource = DEFAULT_BODY, **options: Unpack[Options]
    ) -> None:
        super().__init__(path, format=stanfordextra.FORMAT, images=images, body=body, **options)


class SyntheticDataset(LabelDataset):
    """The synthetic world; with pose="exact", the default, its own cameras are used, and labels are as good as its annotations.

    Args:
        made: what is drawn.
        **options: LabelDataset's.

    """

    def __init__(self, made: SyntheticSet, **options: Unpack[Options]) -> None:
        options.setdefault("pose", "exact")
        super().__init__(SyntheticSource(made), **options)
