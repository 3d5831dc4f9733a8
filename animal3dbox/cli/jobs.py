"""The commands: each is a dataclass whose fields are its options.

tyro builds a job from the command line: the class docstring is the command's description, the
attribute docstrings are the help. runners.py runs a job.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from animal3dbox.cli.bench_jobs import BenchJob
from animal3dbox.cli.options import (
    BodyOptions,
    CacheOptions,
    CameraOptions,
    DatasetOptions,
    FaultOptions,
    KeypointDatasetOptions,
    MethodOptions,
    Metric,
    ScaleOptions,
    StoredCamera,
)
from animal3dbox.cli.setup_jobs import ConvertModelJob, DoctorJob, VocabulariesJob
from animal3dbox.labels.config import LabelConfig

if TYPE_CHECKING:
    from animal3dbox.datasets.labelling.scale import ScaleSource


@dataclass(frozen=True, kw_only=True)
class DemoJob:
    """Render posed quadrupeds, label them from noisy keypoints, and compare with the truth.

    Example: animal3dbox demo --n 4 --out demo-output
    """

    out: Path = Path("demo-output")
    """folder for the results"""
    n: int = 12
    """animals"""
    seed: int = 0
    """another seed gives other animals"""
    noise_px: float = 2.0
    """standard deviation of the keypoints' noise"""
    outliers: float = 0.0
    """part of the keypoints, 0 to 1, that lie anywhere in the image"""
    rigid: bool = False
    """label with the standing species, as for photographs, not with the true pose"""
    json: bool = False
    """print the result as JSON"""


@dataclass(frozen=True, kw_only=True)
class LabelJob:
    """Label the animals of a dataset: cuboids with named faces, tables, pictures and a gallery.

    Example: animal3dbox label StanfordExtra --body dog --out labels
    """

    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """a dataset's folder or its annotation file"""
    out: Path | None = None
    """folder for labels.json, labels.csv, overlays, gallery.html and report.json"""
    table: Path | None = None
    """folder for a table with a row for every animal, in parts, and no pictures"""
    dataset: KeypointDatasetOptions
    body: BodyOptions
    method: MethodOptions
    camera: CameraOptions
    scale: ScaleOptions
    cache: CacheOptions
    calibration: Path | None = None
    """what `animal3dbox calibrate` learned of this dataset; for bodies without a template"""
    misplaced: Literal["fault", "flag"] = "fault"
    """keypoints beside the frame, or the animal's own box or mask: an error, or a flag"""
    pictures: Literal["all", "flagged", "none"] = "all"
    """with --out: of which animals pictures are drawn; flagged: of rejected ones, too"""
    outline: bool = True
    """draw the outlines of fitted bodies into the pictures"""
    json: bool = False
    """print report.json instead of words"""

    @cached_property
    def config(self) -> LabelConfig:
        """How each label is made."""
        return self.method.config()

    @cached_property
    def scale_source(self) -> "ScaleSource | None":
        """Where metres come from."""
        return self.scale.source()


@dataclass(frozen=True, kw_only=True)
class SynthJob:
    """Write a synthetic dataset.

    Pictures of posed quadrupeds, annotations with faults by a dial, and the truth.

    Example: animal3dbox synth --out world --n 20 --noise-px 2
    """

    out: Path
    """folder for the dataset"""
    n: int = 100
    """images"""
    seed: int = 0
    """another seed gives another world"""
    format: Literal["animal3d", "stanfordextra"] = "animal3d"
    """the files' format"""
    model: Path | None = None
    """where to write Animal3D's SMAL pickle; default: beside the folder, OUT-model.pkl"""
    width: int = 640
    """of the images, px"""
    height: int = 480
    """of the images, px"""
    mark_hidden: bool = False
    """mark keypoints in the frame that something hides, too"""
    workers: int = 1
    """processes that draw; the files are the same"""
    resume: bool = False
    """go on where the same command was broken off"""
    annotation: FaultOptions


@dataclass(frozen=True, kw_only=True)
class EvaluateJob:
    """Repeat the paper's evaluation on a world of known truth, or what of it a dataset allows.

    Example: animal3dbox evaluate --n 100 --out evaluation
    """

    path: Annotated[Positional[Path | None], arg(metavar="[PATH]")] = None
    """a dataset's folder or annotation file; without: our world"""
    out: Path = Path("evaluation")
    """folder for evaluation.json, .txt and .html"""
    n: int = 500
    """animals of our world"""
    seed: int = 0
    """another seed gives another world"""
    fits: int = 0
    """of our world: so many animals are also fitted, beside rigid and true bodies, some 2 s each"""
    workers: int = 2
    """processes; the results are the same"""
    pictures: bool = True
    """draw the paper's figures of our world too (extra plots)"""
    dataset: DatasetOptions
    body: BodyOptions


@dataclass(frozen=True, kw_only=True)
class ExportJob:
    """Write cuboids for other tools: Omni3D json, COCO keypoints, KITTI text files, 2D prompts.

    Or the parameters of fitted bodies: Animal3D json of a SMAL model's, our own of the quadruped's.
    Or labels for ecologists: Camtrap DP observations, wildlife-datasets' table, WBIA's COCO.

    Example: animal3dbox export labels --to omni3d --out omni3d.json
    """

    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """labels.json, the folder that label wrote, an Omni3D JSON, or a folder of KITTI's"""
    to: Literal[
        "omni3d",
        "coco",
        "kitti",
        "oracle2d",
        "animal3d",
        "quadruped",
        "camtrap-dp",
        "wildlife-datasets",
        "wbia",
    ]
    """the format to write"""
    out: Path
    """folder, or but for kitti a file (.json; .csv for camtrap-dp and wildlife-datasets)"""
    datapackage: Path | None = None
    """of camtrap-dp: the folder of the datapackage.json whose media.csv the images are in"""
    model: Path | None = None
    """for animal3d: the SMAL model that was fitted (.pkl, .safetensors)"""
    images: Path | None = None
    """folder that an Omni3D file's image paths are relative to, or of KITTI's pictures"""
    metric: Metric = "info"
    """of cuboids: lengths are metres, or not, or as the file's info says (few Omni3D files do)"""
    metres_per_unit: float | None = None
    """scale of the boxes whose scale is not known"""
    scale_free: bool = False
    """write lengths of unknown scale as they are"""
    first_id: int | None = None
    """number of the first image and box: 1, but for kitti's images 0; an export that is to be
    joined with another one goes on where that ended"""
    dataset_id: int | None = None
    """of omni3d: the dataset's own, 0; another one for each that is joined"""
    split: str | None = None
    """of omni3d's info, or kitti's ImageSets: train"""
    categories: tuple[str, ...] = ()
    """of omni3d, coco and oracle2d: names in the order of their numbers, the same for exports that
    are joined; none: the boxes' own"""


@dataclass(frozen=True, kw_only=True)
class CheckJob:
    """Check labels for what cannot be true.

    Cuboids against their corners, projections, faces, boxes and cameras, as training loops do.

    Example: animal3dbox check labels
    """

    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """labels.json, the folder that label wrote, an Omni3D JSON, a folder of KITTI's, or a dataset,
    which is labelled"""
    dataset: KeypointDatasetOptions
    body: str | None = None
    """of a dataset: one body for all, a preset's name or a model's file"""
    stored_camera: StoredCamera = "hypothesis"
    """of a dataset: take its stored camera as a guess or as known"""
    cache: Path | None = None
    """of a dataset: its label cache"""
    metric: Metric = "info"
    """of cuboids: lengths are metres, or not, or as the file's info says (few Omni3D files do)"""
    workers: int = 0
    """of a dataset: processes"""
    json: bool = False
    """print everything that is wrong as JSON"""


@dataclass(frozen=True, kw_only=True)
class CompareJob:
    """Lay a detector's boxes beside labels: who is whose, how far they differ, and pictures.

    Labels are drawn solid and detections dashed.

    Example: animal3dbox compare labels --with predictions.pth --truth omni3d.json --out compared
    """

    path: Annotated[Positional[Path], arg(metavar="LABELS")]
    """labels.json, the folder that label wrote, an Omni3D JSON, or a folder of KITTI's"""
    predictions: Annotated[Path, arg(name="with", metavar="PRED")]
    """the file or folder of Cube R-CNN, OVMono3D, 3D-MOOD, WildDet3D, DetAny3D, Boxer, WildLIFT, or
    KITTI's results"""
    truth: Path
    """the Omni3D JSON that was detected on, such as export made of the labels"""
    out: Path
    """folder for compare.json, compare.csv, compare.html and pictures"""
    layout: str | None = None
    """the layout of --with (cubercnn, detect3d, detany3d, boxer, tracks, frames, kitti), if it is
    not to be recognised"""
    cameras: str | None = None
    """poses of the cameras, of detections in a world: a file or folder; or the word camera"""
    category_ids: Literal["dataset", "contiguous"] | None = None
    """what numbers of categories are: the truth's ids, or places from 0; none: as the layout has"""
    heading: Literal["known", "unknown", "layout"] = "layout"
    """whether fronts of detections mean something, or as the layout says"""
    least_score: float = 0.0
    """detections below are left out, and counted"""
    images: Path | None = None
    """folder that the truth's image paths are relative to"""
    metric: Metric = "info"
    """of cuboids: lengths are metres, or not, or as the file's info says (few Omni3D files do)"""
    metres_per_unit: float | None = None
    """scale of the labels whose scale is not known"""
    pictures: int = 24
    """how many pictures are drawn, the worst matches first"""
    json: bool = False
    """print compare.json instead of words"""


@dataclass(frozen=True, kw_only=True)
class InspectJob:
    """Say what is in a copy of a dataset: counts, keys, masks, cameras and frames, sides, faults.

    Changes nothing.

    Example: animal3dbox inspect Animal3D --model smal.pkl
    """

    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """a dataset's folder or its annotation file"""
    dataset: KeypointDatasetOptions
    fits: bool = False
    """with --model: compare stored parameters with bodies fitted here, of 200 animals at most"""
    json: bool = False
    """print JSON instead of words"""


@dataclass(frozen=True, kw_only=True)
class CalibrateJob:
    """Learn from a dataset's own animals where its keypoints lie, and what shapes they have.

    The placement is for bodies without a template, such as a folder of meshes; places and shapes
    are for bodies that are fitted to photographs. Labels that are given the file are truer.

    Example: animal3dbox calibrate photos --learn places,shapes --out calibration.json
    """

    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """a dataset's folder or its annotation file"""
    out: Path = Path("calibration.json")
    """the file to write"""
    learn: str = "placement"
    """what, with commas: placement (of bodies without a template), or places (of keypoints on
    fitted bodies) and shapes (of the dataset's categories), which take two fits an animal; if
    interrupted, the same command goes on from the fits beside --out"""
    focal_px: float | None = None
    """focal length of images without a camera of their own; else it is estimated"""
    dataset: KeypointDatasetOptions
    body: BodyOptions
    json: bool = False
    """print the file's content instead of words"""


@dataclass(frozen=True, kw_only=True)
class GalleryJob:
    """Draw a sample of a table of labels: the least confident ones, and some at random.

    Example: animal3dbox gallery table --worst 200 --random 50
    """

    path: Annotated[Positional[Path], arg(metavar="TABLE")]
    """the folder that label --table wrote"""
    out: Path | None = None
    """the HTML file; default: beside the table, TABLE-gallery.html"""
    worst: int = 200
    """labels of least confidence"""
    random: int = 50
    """labels drawn from the others"""
    seed: int = 0
    """another seed draws others"""
    images: Path | None = None
    """folder that the images' names are relative to, if they were moved"""


Job = (
    DemoJob
    | LabelJob
    | SynthJob
    | EvaluateJob
    | ExportJob
    | CheckJob
    | CompareJob
    | BenchJob
    | InspectJob
    | ConvertModelJob
    | CalibrateJob
    | GalleryJob
    | VocabulariesJob
    | DoctorJob
)
"""Any command with its options."""
COMMANDS: dict[str, Callable[..., Job]] = {
    "demo": DemoJob,
    "label": LabelJob,
    "synth": SynthJob,
    "evaluate": EvaluateJob,
    "export": ExportJob,
    "check": CheckJob,
    "compare": CompareJob,
    "bench": BenchJob,
    "inspect": InspectJob,
    "convert-model": ConvertModelJob,
    "calibrate": CalibrateJob,
    "gallery": GalleryJob,
    "vocabularies": VocabulariesJob,
    "doctor": DoctorJob,
}
"""Every command by its name on the command line, in the order of `--help`."""
