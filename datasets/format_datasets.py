"""The torch Datasets, one a format.

Each reads its annotations and leaves the rest to LabelDataset.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Literal, TypedDict, Unpack

from animal3dbox.datasets.bodies.mesh_folder import MeshFolderBodies
from animal3dbox.datasets.bodies.options import DEFAULT_BODY, body_source
from animal3dbox.datasets.bodies.sources import BodySource, ParametersBody
from animal3dbox.datasets.formats import ReadOptions, bodies_for, read_dataset
from animal3dbox.datasets.label_dataset import LabelDataset, OnBad, TransformCall
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.labelling.filters import LabelFilter
from animal3dbox.datasets.labelling.label_records import CameraPolicy
from animal3dbox.datasets.labelling.scale import ScaleSource
from animal3dbox.datasets.labelling.synthetic_source import SyntheticSource
from animal3dbox.datasets.readers import stanfordextra
from animal3dbox.datasets.readers.animal3d import reader as animal3d
from animal3dbox.datasets.readers.coco import reader as coco
from animal3dbox.datasets.readers.deeplabcut import reader as deeplabcut
from animal3dbox.datasets.readers.mesh_folder import reader as mesh_folder
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.labels.config import LabelConfig
from animal3dbox.smal.keypoints.vocabularies import vocabulary_of_option
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


class Options(TypedDict, total=False):
    """LabelDataset's options."""

    config: LabelConfig | None
    on_bad: OnBad
    partial: Literal["keep", "skip"]
    filters: LabelFilter | None
    classes: Sequence[str] | None
    transform: TransformCall | None
    scale: ScaleSource | None
    stored_cameras: CameraPolicy
    cache: Path | str | None
    masks: bool
    report_to: Path | str | None
    reuse: bool


class AnnotatedDataset(LabelDataset):
    """Animals of any format that can be read; the format is recognised, or given.

    Args:
        path: the dataset's folder or annotation file.
        format: of datasets.formats.FORMATS, or "auto".
        images: the folder that image paths are relative to, if not the usual one.
        model: the SMAL file of the dataset's own parameters or meshes.
        vocabulary: what the keypoints are, if their names do not tell: a vocabulary, its name, or a
            TOML file.
        body: one body for all animals, a preset's name, a model's file or a source; None: the
            dataset's own, else a dog.
        focal_px: of every image without a camera of its own; None: what the dataset or the
            picture's header says, or a guess.
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
        focal_px: float | None = None,
        **options: Unpack[Options],
    ) -> None:
        folder, file = (None if p is None else Path(p) for p in (images, model))
        words = vocabulary_of_option(vocabulary) if isinstance(vocabulary, str) else vocabulary
        read = read_dataset(Path(path), format, ReadOptions(folder, file, words, focal_px))
        own = body_source(body) if isinstance(body, str) else body
        bodies = bodies_for(read, own)
        super().__init__(
            FileSource(
                read.records,
                (
                    bodies.packed()
                    if isinstance(bodies, ParametersBody | MeshFolderBodies)
                    else bodies
                ),
            ),
            **options,
        )


class Animal3DDataset(AnnotatedDataset):
    """Animal3D, its 2D-only relatives and what is written like it.

    Args:
        path: the folder, or one of its json files.
        model: the SMAL file of its parameters; without it all animals get ``body``.
        images: the folder that img_path is relative to; None: the json's.
        body: one body for all animals instead of their own.
        focal_px: see AnnotatedDataset.
        **options: LabelDataset's.

    """

    def __init__(
        self,
        path: Path | str,
        model: Path | str | None = None,
        *,
        images: Path | str | None = None,
        body: str | BodySource | None = None,
        focal_px: float | None = None,
        **options: Unpack[Options],
    ) -> None:
        super().__init__(
            path,
            format=animal3d.FORMAT,
            images=images,
            model=model,
            body=body,
            focal_px=focal_px,
            **options,
        )


class StanfordExtraDataset(AnnotatedDataset):
    """StanfordExtra: dogs.

    Args:
        path: the json, or the folder it lies in.
        images: the folder that img_path is relative to.
        body: of all animals.
        focal_px: see AnnotatedDataset.
        **options: LabelDataset's.

    """

    def __init__(
        self,
        path: Path | str,
        *,
        images: Path | str | None = None,
        body: str | BodySource = DEFAULT_BODY,
        focal_px: float | None = None,
        **options: Unpack[Options],
    ) -> None:
        super().__init__(
            path,
            format=stanfordextra.FORMAT,
            images=images,
            body=body,
            focal_px=focal_px,
            **options,
        )


class NamedKeypointsDataset(AnnotatedDataset):
    """Keypoints that are told apart by their names, and no bodies.

    Args:
        path: the annotation file, or its folder.
        images: the folder that image paths are relative to, if not the usual one.
        vocabulary: what the keypoints are, if their names do not tell.
        body: of all animals.
        focal_px: see AnnotatedDataset.
        **options: LabelDataset's.

    """

    FORMAT: ClassVar[str]

    def __init__(
        self,
        path: Path | str,
        *,
        images: Path | str | None = None,
        vocabulary: str | Vocabulary | None = None,
        body: str | BodySource = DEFAULT_BODY,
        focal_px: float | None = None,
        **options: Unpack[Options],
    ) -> None:
        super().__init__(
            path,
            format=self.FORMAT,
            images=images,
            vocabulary=vocabulary,
            body=body,
            focal_px=focal_px,
            **options,
        )


class CocoKeypointsDataset(NamedKeypointsDataset):
    """COCO keypoints, such as AP-10K and AnimalPose; the animals of an image together."""

    FORMAT = coco.FORMAT


class DeepLabCutDataset(NamedKeypointsDataset):
    """DeepLabCut's h5 or csv beside a folder of images.

    H5 needs the extra animal3dbox[deeplabcut].
    """

    FORMAT = deeplabcut.FORMAT


class MeshFolderDataset(AnnotatedDataset):
    """Images with a mesh file for each animal, and cameras or keypoints.

    Cameras that the folder gives are used as they are.

    Args:
        path: the folder, see docs/formats.md.
        model: the SMAL file that the meshes correspond to, if they do.
        vocabulary: what the keypoints are, if the folder does not say.
        **options: LabelDataset's.

    """

    def __init__(
        self,
        path: Path | str,
        *,
        model: Path | str | None = None,
        vocabulary: str | Vocabulary | None = None,
        **options: Unpack[Options],
    ) -> None:
        super().__init__(
            path, format=mesh_folder.FORMAT, model=model, vocabulary=vocabulary, **options
        )


class Omni3DDataset(LabelDataset):
    """Boxes of any kind in Omni3D's format, as they are: nothing is estimated, no animal is needed.

    Without a known heading, targets have no face fields: which side is the front would be a guess.

    Args:
        path: the json.
        images: the folder that file_path is relative to.
        heading_known: whether forward and left mean something; None: what the file says if this
            package wrote it, else not.
        **options: LabelDataset's; those about labelling have no effect.

    """

    def __init__(
        self,
        path: Path | str,
        *,
        images: Path | str | None = None,
        heading_known: bool | None = None,
        **options: Unpack[Options],
    ) -> None:
        read = read_omni3d(
            Path(path), None if images is None else Path(images), heading_known=heading_known
        )
        super().__init__(FileSource(read), **options)


class SyntheticDataset(LabelDataset):
    """The synthetic world.

    With pose="exact", the default, its own cameras are used, and labels are as good as its
    annotations.

    Args:
        made: what is drawn.
        **options: LabelDataset's.

    """

    def __init__(self, made: SyntheticSet, **options: Unpack[Options]) -> None:
        options.setdefault("stored_cameras", "exact")
        super().__init__(SyntheticSource(made), **options)
