"""Groups of options that commands share, as dataclasses that tyro fills from the command line.

The attribute docstrings are the help texts. A group's name is no part of its flags (see main.py),
so `scale.metres_per_unit` is `--metres-per-unit`. Nothing here imports torch when it is loaded:
`--help` answers at once.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from animal3dbox.errors import ConfigError
from animal3dbox.labels.config import (
    Axes,
    Focal,
    LabelConfig,
    Labelings,
    Method,
    Residual,
    Tail,
    Upright,
)

if TYPE_CHECKING:
    from animal3dbox.datasets.bodies.sources import BodySource
    from animal3dbox.datasets.labelling.scale import ScaleSource
    from animal3dbox.datasets.read_options import ReadOptions
    from animal3dbox.datasets.synthetic.faults import FaultConfig

Format = Literal[
    "auto",
    "animal3d",
    "mesh_folder",
    "coco",
    "deeplabcut",
    "stanfordextra",
    "omni3d",
    "kitti",
]
"""The formats of datasets.formats and, after stanfordextra, those of cuboids, which have nothing to
label (datasets.cuboid_formats). Their import would load torch; a test compares them."""

StoredCamera = Literal["hypothesis", "exact"]
"""The policies of datasets.labelling.label_records, likewise."""

Metric = Literal["yes", "no", "info"]
"""Whether lengths are metres, of datasets.readers.cuboid_checks, likewise."""

Swap = Literal["none", "all", "legs", "fore", "hind", "head"]
"""The exchanges of datasets.synthetic.faults, likewise."""


@dataclass(frozen=True, kw_only=True)
class DatasetOptions:
    """How the dataset is read."""

    format: Format = "auto"
    """the annotations' format"""
    images: Path | None = None
    """folder that the image paths are relative to"""
    model: Path | None = None
    """the SMAL model (.pkl, .safetensors) of the dataset's own parameters or meshes; with
    --body fit the model that is fitted"""
    orientation: Literal["stored", "apply"] = "stored"
    """pixels of pictures and masks as their files store them, or turned as their EXIF headers say:
    apply it if the annotations were made on the turned pictures"""

    def read_options(self, focal_px: float | None = None) -> "ReadOptions":
        """The options as `read_dataset` takes them.

        Args:
            focal_px: of every image without a camera of its own.

        Raises:
            ConfigError: a focal length that is not positive.

        """
        from animal3dbox.datasets.read_options import ReadOptions

        return ReadOptions(
            self.images,
            self.model,
            focal_px=focal_px,
            apply_orientation=self.applies_orientation,
        )

    @property
    def applies_orientation(self) -> bool:
        """Whether pictures are turned as their headers say."""
        return self.orientation == "apply"


@dataclass(frozen=True, kw_only=True)
class KeypointDatasetOptions(DatasetOptions):
    """How the dataset is read."""

    vocabulary: str | None = None
    """what the keypoints are if their names do not tell: a vocabulary's name or a TOML file"""
    optional: Literal["drop", "fault"] | None = None
    """a bad mask or box: left out with a note, which is the default but for --cache, or an error"""
    visibility: Literal["flags", "scores"] = "flags"
    """what stands beside a keypoint: 0, 1 or 2, or how sure a network was of it"""
    categories: tuple[str, ...] = ()
    """names of those that are read; none: all with an animal's keypoints"""
    check_paths: bool = False
    """look up every picture before the first is labelled, where that is not done anyway (COCO with
    label and check): a missing one is an error at once"""
    index: Path | None = None
    """of COCO with label and check: folder of the index by which the file is opened again at once;
    default: in the cache's folder, else in the table's, else none"""
    keep: tuple[Literal["location"], ...] = ()
    """what the dataset's file says and labels hold only if asked: the place of the camera"""

    def read_options(self, focal_px: float | None = None) -> "ReadOptions":
        """The options as `read_dataset` takes them, with the vocabulary.

        Args:
            focal_px: of every image without a camera of its own.

        Raises:
            ConfigError: an unknown vocabulary, or a focal length that is not positive.

        """
        from animal3dbox.smal.keypoints.vocabularies import vocabulary_of_option

        options = replace(
            super().read_options(focal_px),
            optional=self.optional or "drop",
            visibility=self.visibility,
            categories=self.categories,
            keep=self.keep,
        )
        if self.vocabulary is None:
            return options
        return replace(options, vocabulary=vocabulary_of_option(self.vocabulary))


@dataclass(frozen=True, kw_only=True)
class BodyOptions:
    """Which body the animals have, if not each its own."""

    name: Annotated[str | None, arg(name="body")] = None
    """one body for all: a preset of the quadruped (dog, cat, ...), a SMAL model or a mesh file;
    "preset", the rigid one of each animal's category, else a dog; or "fit", a body fitted to each
    animal's keypoints and mask, which is the default without --model"""
    landmarks: Path | None = None
    """JSON with the landmarks of the mesh file, or of a fitted model that is not SMAL's mesh: names
    (nose, tail_base, ...) to lists of vertex ids"""
    species: str = "auto"
    """of fitted animals and presets: one for all, by each one's category (auto), or unknown"""

    def source(self, model: Path | None) -> "BodySource | None":
        """The one body of all animals, or None where the options name none.

        Args:
            model: --model: with "fit" the model that is fitted, else the dataset's own, which
                excludes one body for all.

        Raises:
            ConfigError: an unknown body, or a body and a model.
            ModelFileError: the body's or the model's file is refused.

        """
        from animal3dbox.datasets.bodies.options import DEFAULT_BODY, body_source

        if self.name is None and self.landmarks is None and self.species == "auto":
            return None
        name = self.name or DEFAULT_BODY
        source = body_source(
            name, self.landmarks, species=self.species, model=model if self.fits else None
        )
        if model is not None and not self.fits:
            raise ConfigError(
                "--model takes each animal's own body from the dataset's parameters, --body one"
                " for all: give one of them, or --body fit, which fits the model"
            )
        return source

    @property
    def fits(self) -> bool:
        """Whether the options ask for fitted bodies in so many words."""
        return self.name == "fit"

    def read_options(self, dataset: DatasetOptions, focal_px: float | None = None) -> "ReadOptions":
        """How the dataset is read beside these bodies: without the model if that is fitted.

        Args:
            dataset: its options.
            focal_px: of every image without a camera of its own.

        """
        options = dataset.read_options(focal_px)
        return replace(options, model=None) if self.fits else options


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """The cameras, as far as they are known."""

    focal_px: float | None = None
    """focal length of images without a camera of their own; else the dataset's, EXIF's, --focal"""
    stored_camera: StoredCamera = "hypothesis"
    """take the camera that the dataset stores for its bodies as a guess, or as known"""


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """How a label is made."""

    method: Method = "default"
    """camera pose: ours, the paper's, its baseline"""
    axes: Axes = "default"
    """body axes: ours, the paper's, its baseline"""
    residual: Residual = "vector"
    """how the paper's E_total is read (method paper)"""
    tail: Tail = "keep"
    """whether the boxes hold the tail; the same for all animals"""
    min_keypoints: int = 6
    """fewest visible keypoints"""
    focal: Focal = "estimate"
    """a focal length that nothing tells: estimated with the poses of an image, or guessed"""
    labelings: Labelings = "mend"
    """left and right that were exchanged: found and mended, or kept"""
    upright: Upright = "prior"
    """cameras under the ground or rolled: cost a little more, or not (none)"""

    def config(self) -> LabelConfig:
        """The choices as `label_animal` takes them; raises ConfigError for a value out of range."""
        return LabelConfig(
            method=self.method,
            axes=self.axes,
            residual=self.residual,
            tail=self.tail,
            min_keypoints=self.min_keypoints,
            focal=self.focal,
            labelings=self.labelings,
            upright=self.upright,
        )


@dataclass(frozen=True, kw_only=True)
class ScaleOptions:
    """The source of metres, if labels are to be metric."""

    metres_per_unit: float | None = None
    """metres in a unit of the bodies, to make labels metric"""
    species_scale: bool = False
    """make labels metric by typical lengths of species"""
    altitude_m: float | None = None
    """make labels metric by the height of a camera that looks straight down"""

    def source(self) -> "ScaleSource | None":
        """The one scale that the options name, or None.

        Raises:
            ConfigError: two scales, or a length that is not positive.

        """
        from animal3dbox.datasets.labelling.scale import AltitudeScale, KnownScale, SpeciesScale

        sources: list[ScaleSource] = []
        if self.metres_per_unit is not None:
            sources.append(KnownScale(self.metres_per_unit))
        if self.species_scale:
            sources.append(SpeciesScale())
        if self.altitude_m is not None:
            sources.append(AltitudeScale(self.altitude_m))
        if len(sources) > 1:
            raise ConfigError(
                "give one of --metres-per-unit, --species-scale and --altitude-m: they may disagree"
            )
        return sources[0] if sources else None


@dataclass(frozen=True, kw_only=True)
class CacheOptions:
    """How a Dataset's label cache is filled or a table is written, on one machine or on many."""

    folder: Annotated[Path | None, arg(name="cache")] = None
    """fill this label cache of a Dataset with the same options, instead of writing to --out; with
    --table: labels that are in it are used, and new ones stored"""
    shard: str | None = None
    """with --cache or --table: i/n, only the images i, i + n, ... counted from 1"""
    resume: bool = False
    """keep the labels that are there, and make the others; of --out those of an unfinished run"""
    workers: int = 0
    """processes; the results are the same"""
    mask_iou: bool = False
    """with --cache or --table, and --stored-camera exact: measure the masks' overlap"""
    surface_share: bool = False
    """with --cache or --table: measure how much of each side of the animal is seen"""
    part_rows: int = 4096
    """with --table: rows of a part, about; a part is written after a minute in any case"""
    engine: Literal["processes", "ray"] = "processes"
    """with --table: what runs the workers: processes of this command, or actors of Ray Data"""
    address: str | None = None
    """with --engine ray: of a running cluster, such as auto; none: a local one is started"""


@dataclass(frozen=True, kw_only=True)
class FaultOptions:
    """Which faults the annotations have, and how strong they are."""

    noise_px: float = 0.0
    """standard deviation of the keypoints' noise"""
    outliers: float = 0.0
    """part of the keypoints that lie anywhere in the image"""
    missing: float = 0.0
    """part of the keypoints that are not marked"""
    zeros: float = 0.0
    """part of the keypoints left at (0, 0) but marked"""
    wrong_flags: float = 0.0
    """part of the keypoints whose visibility is the opposite"""
    swap: Swap = "none"
    """exchange left and right of these"""
    swapped: float = 1.0
    """part of the animals to which that happens"""
    focal_factor: float = 1.0
    """focal length told, by the true one"""
    joint_deg: float = 0.0
    """standard deviation of the fitted joints' angles from the true ones"""
    body_scale: float = 1.0
    """size of the fitted body, by the true one"""
    mask_px: int = 0
    """grow the masks by so many px, or shrink them if negative"""

    def config(self) -> "FaultConfig":
        """The faults as the synthetic world takes them; ConfigError for a value out of range."""
        from animal3dbox.datasets.synthetic.faults import FaultConfig

        return FaultConfig(**asdict(self))
