"""The torch Datasets, one a format.

Each reads its annotations and leaves the rest to LabelDataset.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Literal, Unpack, get_args

from animal3dbox.datasets.bodies.fitted import FIT
from animal3dbox.datasets.bodies.mesh_folder import MeshFolderBodies
from animal3dbox.datasets.bodies.options import DEFAULT_BODY, body_source
from animal3dbox.datasets.bodies.own_or_fitted import OwnOrFittedBodies
from animal3dbox.datasets.bodies.sources import BodySource, ParametersBody
from animal3dbox.datasets.formats import bodies_for, read_dataset
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.dataset_options import Options
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.read_options import Keep, ReadOptions
from animal3dbox.datasets.readers import stanfordextra
from animal3dbox.datasets.readers.animal3d import entries as animal3d_entries
from animal3dbox.datasets.readers.animal3d import reader as animal3d
from animal3dbox.datasets.readers.coco import reader as coco
from animal3dbox.datasets.readers.deeplabcut import reader as deeplabcut
from animal3dbox.datasets.readers.mesh_folder import reader as mesh_folder
from animal3dbox.datasets.readers.tolerance import Visibility
from animal3dbox.errors import ConfigError
from animal3dbox.files import user_path
from animal3dbox.smal.keypoints.vocabularies import vocabulary_of_option
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

INDEXES = "indexes"
"""Name of the folder of indexes in that of a label cache."""
Split = Literal["train", "test", "all"]


class ReadingOptions(Options, total=False):
    """Options of AnnotatedDataset that the Datasets of all formats take, and LabelDataset's.

    Example:
        >>> options: ReadingOptions = {"categories": ("deer",), "on_bad": "skip"}
    """

    visibility: Visibility
    categories: Sequence[str]
    keep: Sequence[Keep]
    apply_orientation: bool
    check_paths: bool
    index: Path | str | None


class AnnotatedDataset(LabelDataset):
    """Animals of any format that can be read; the format is recognised, or given.

    Args:
        root: the dataset's folder or annotation file.
        format: of datasets.formats.FORMATS, or "auto".
        split: "train", "test" or "all" of a format whose folder holds its splits (Animal3D).
        images: the folder that image paths are relative to, if not the usual one.
        model: the SMAL file of the dataset's own parameters or meshes; with body="fit" the model
            that is fitted.
        vocabulary: what the keypoints are, if their names do not tell: a vocabulary, its name, or a
            TOML file.
        body: one body for all animals, a preset's name, a model's file or a source; None: the
            dataset's own, else one fitted to each animal.
        focal_px: of every image without a camera of its own; None: what the dataset or the
            picture's header says, or a guess.
        visibility: what stands beside a keypoint: "flags" (0, 1, 2), or a network's "scores".
        categories: names of those that are read, of files that list some; none: all with an
            animal's keypoints.
        keep: what the file says and meta["sightings"] holds only if asked: ("location",).
        apply_orientation: whether pictures and masks are turned as their EXIF headers say, of
            annotations that were made on turned pictures; False: pixels are as stored.
        check_paths: whether every picture is looked up now, so that a missing one is a fault before
            anything is read; else, of COCO (other formats always look), when it is read.
        index: folder of the index by which a COCO file is opened again in seconds; None: in the
            label cache's folder, if there is a cache, else none is kept.
        **options: LabelDataset's.

    Raises:
        ConfigError: an option that the format has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.
        SampleError: see LabelDataset.

    Example:
        >>> import tempfile, pathlib
        >>> from animal3dbox.datasets.synthetic import (
        ...     SyntheticSet, WorldConfig, animal3d_world, write_animal3d)
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> small = animal3d_world(WorldConfig(image_hw=(120, 160)))
        >>> _ = write_animal3d(SyntheticSet(0, 4, small), folder / "set", folder / "model.pkl")
        >>> len(AnnotatedDataset(folder / "set", model=folder / "model.pkl"))
        4
    """

    def __init__(
        self,
        root: Path | str,
        *,
        format: str = "auto",
        split: Split = "all",
        images: Path | str | None = None,
        model: Path | str | None = None,
        vocabulary: str | Vocabulary | None = None,
        body: str | BodySource | None = None,
        focal_px: float | None = None,
        visibility: Visibility = "flags",
        categories: Sequence[str] = (),
        keep: Sequence[Keep] = (),
        apply_orientation: bool = False,
        check_paths: bool = False,
        index: Path | str | None = None,
        **options: Unpack[Options],
    ) -> None:
        if isinstance(categories, str):
            raise ConfigError(
                f"categories must be several names, got {categories!r}: write [{categories!r}]"
            )
        folder, file = (None if p is None else user_path(p) for p in (images, model))
        if isinstance(vocabulary, str):
            vocabulary = vocabulary_of_option(vocabulary)
        fitted = file if body == FIT else None
        self.root, self.split = user_path(root), split
        dataset = read_dataset(
            _split_file(self.root, format, split),
            format,
            ReadOptions(
                folder,
                None if fitted is not None else file,
                vocabulary,
                focal_px,
                optional=options.get("optional", "fault"),
                visibility=visibility,
                categories=tuple(categories),
                keep=tuple(keep),
                apply_orientation=apply_orientation,
                check_paths=check_paths,
                index_folder=_index_folder(index, options.get("cache")),
            ),
        )
        own_body = body_source(body, model=fitted) if isinstance(body, str) else body
        bodies = bodies_for(dataset, own_body)
        if isinstance(bodies, ParametersBody | MeshFolderBodies | OwnOrFittedBodies):
            bodies = bodies.packed()
        self.bodies = bodies
        super().__init__(FileSource(dataset.records, bodies), **options)

    def __repr__(self) -> str:
        kind, *lines = super().__repr__().split("\n")
        where = f"    Root location: {self.root}\n    Split: {self.split}"
        return "\n".join([kind, *lines[:1], where, *lines[1:]])


def _index_folder(index: Path | str | None, cache: Path | str | None) -> Path | None:
    """The folder of indexes: the one that is given, or one in the label cache's folder."""
    if index is not None:
        return user_path(index)
    return None if cache is None else user_path(cache) / INDEXES


def _split_file(root: Path, format: str, split: Split) -> Path:
    """The folder or file to read of a dataset's split.

    Raises:
        ConfigError: there is no such split, or the format keeps each in a file of its own.

    """
    if split not in get_args(Split):
        raise ConfigError(f"split must be {', '.join(get_args(Split))}, got {split!r}")
    if split == "all":
        return root
    has_splits = any((root / name).is_file() for name in animal3d_entries.SPLITS)
    if format not in ("auto", animal3d.FORMAT) or not has_splits:
        raise ConfigError(
            f"split={split!r} is for a folder that holds {' and '.join(animal3d_entries.SPLITS)}:"
            " of other formats give the annotation file of the split that you want as root"
        )
    file = root / f"{split}.json"
    if not file.is_file():
        raise ConfigError(f"split={split!r} needs {file}, and there is no such file")
    return file


class Animal3DDataset(AnnotatedDataset):
    """Animal3D, its 2D-only relatives and what is written like it.

    Features: photographs of mammals with 26 keypoints, masks, and the parameters of a SMAL body for
    each animal, which need ``model``. Format: ``root`` holds train.json and test.json beside the
    images (docs/formats.md). Classes: the species, as the files list them.

    If you use the dataset, cite Xu et al., "Animal3D: A Comprehensive Dataset of 3D Animal Pose and
    Shape", ICCV 2023.

    Args:
        root: the folder, or one of its json files.
        model: the SMAL file of its parameters; without it all animals get ``body``.
        split: "train", "test" or "all".
        images: the folder that img_path is relative to; None: the json's.
        body: one body for all animals instead of their own.
        focal_px: see AnnotatedDataset.
        **options: ReadingOptions, and LabelDataset's.

    Example:
        >>> import tempfile, pathlib
        >>> from animal3dbox.datasets.synthetic import (
        ...     SyntheticSet, WorldConfig, animal3d_world, write_animal3d)
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> small = animal3d_world(WorldConfig(image_hw=(120, 160)))
        >>> _ = write_animal3d(SyntheticSet(0, 4, small), folder / "set", folder / "model.pkl")
        >>> dataset = Animal3DDataset(folder / "set", folder / "model.pkl", split="train")
        >>> dataset[0][1]["corners_3d"].shape
        torch.Size([1, 8, 3])
    """

    def __init__(
        self,
        root: Path | str,
        model: Path | str | None = None,
        *,
        split: Split = "all",
        images: Path | str | None = None,
        body: str | BodySource | None = None,
        focal_px: float | None = None,
        **options: Unpack[ReadingOptions],
    ) -> None:
        super().__init__(
            root,
            format=animal3d.FORMAT,
            split=split,
            images=images,
            model=model,
            body=body,
            focal_px=focal_px,
            **options,
        )


class StanfordExtraDataset(AnnotatedDataset):
    """StanfordExtra: photographs of dogs.

    Features: 24 keypoints and a mask in runs; no bodies. Format: StanfordExtra's json and the
    folder of Stanford Dogs' images. Classes: dog.

    If you use the dataset, cite Biggs et al., "Who Left the Dogs Out? 3D Animal Reconstruction with
    Expectation Maximization in the Loop", ECCV 2020.

    Args:
        root: the json, or the folder it lies in.
        images: the folder that img_path is relative to.
        body: of all animals.
        focal_px: see AnnotatedDataset.
        **options: ReadingOptions, and LabelDataset's.

    Example:
        >>> import tempfile, pathlib
        >>> from animal3dbox.datasets.synthetic import SyntheticSet, WorldConfig
        >>> from animal3dbox.datasets.synthetic import write_stanfordextra
        >>> folder = pathlib.Path(tempfile.mkdtemp()) / "set"
        >>> from animal3dbox.smal import VOCABULARIES
        >>> world = WorldConfig(image_hw=(120, 160), vocabulary=VOCABULARIES["stanfordextra24"])
        >>> _ = write_stanfordextra(SyntheticSet(0, 2, world), folder)
        >>> len(StanfordExtraDataset(folder, on_bad="skip"))
        2
    """

    def __init__(
        self,
        root: Path | str,
        *,
        images: Path | str | None = None,
        body: str | BodySource = DEFAULT_BODY,
        focal_px: float | None = None,
        **options: Unpack[ReadingOptions],
    ) -> None:
        super().__init__(
            root,
            format=stanfordextra.FORMAT,
            images=images,
            body=body,
            focal_px=focal_px,
            **options,
        )


class NamedKeypointsDataset(AnnotatedDataset):
    """Keypoints that are told apart by their names, and no bodies: the base of two Datasets.

    Args:
        root: the annotation file, or its folder.
        images: the folder that image paths are relative to, if not the usual one.
        vocabulary: what the keypoints are, if their names do not tell.
        body: of all animals.
        focal_px: see AnnotatedDataset.
        **options: ReadingOptions, and LabelDataset's.

    """

    FORMAT: ClassVar[str]

    def __init__(
        self,
        root: Path | str,
        *,
        images: Path | str | None = None,
        vocabulary: str | Vocabulary | None = None,
        body: str | BodySource = DEFAULT_BODY,
        focal_px: float | None = None,
        **options: Unpack[ReadingOptions],
    ) -> None:
        super().__init__(
            root,
            format=self.FORMAT,
            images=images,
            vocabulary=vocabulary,
            body=body,
            focal_px=focal_px,
            **options,
        )


class CocoKeypointsDataset(NamedKeypointsDataset):
    """COCO keypoints, such as AP-10K and AnimalPose; the animals of an image together.

    Features: keypoints by their names, masks in runs or polygons; no bodies. Format: a json with
    images, annotations and categories. Classes: the file's categories.

    Example:
        >>> CocoKeypointsDataset("nowhere.json")
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: there is no file or folder nowhere.json
    """

    FORMAT = coco.FORMAT


class DeepLabCutDataset(NamedKeypointsDataset):
    """DeepLabCut's h5 or csv beside a folder of images.

    Features: keypoints by their names; no masks, no bodies. Format: CollectedData_*.csv, or .h5,
    which needs the extra animal3dbox[deeplabcut].

    If you use DeepLabCut, cite Mathis et al., "DeepLabCut: markerless pose estimation of
    user-defined body parts with deep learning", Nature Neuroscience 2018.

    Example:
        >>> DeepLabCutDataset("nowhere.csv")
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: there is no file or folder nowhere.csv
    """

    FORMAT = deeplabcut.FORMAT


class MeshFolderDataset(AnnotatedDataset):
    """Images with a mesh file for each animal, and cameras or keypoints.

    Cameras that the folder gives are used as they are. Format: docs/formats.md.

    Args:
        root: the folder.
        model: the SMAL file that the meshes correspond to, if they do.
        vocabulary: what the keypoints are, if the folder does not say.
        **options: ReadingOptions, and LabelDataset's.

    Example:
        >>> MeshFolderDataset("nowhere")
        Traceback (most recent call last):
        animal3dbox.errors.DatasetNotFoundError: there is no file or folder nowhere
    """

    def __init__(
        self,
        root: Path | str,
        *,
        model: Path | str | None = None,
        vocabulary: str | Vocabulary | None = None,
        **options: Unpack[ReadingOptions],
    ) -> None:
        super().__init__(
            root, format=mesh_folder.FORMAT, model=model, vocabulary=vocabulary, **options
        )
