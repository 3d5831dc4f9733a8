"""Annotated animals as torch Datasets whose labels are made on the way.

The rooms, in their order; each imports only from those before it (tests/test_package.py):

- `records`, `images`, `storage`: what a dataset says of an animal, pixels, values as bytes.
- `readers`, `bodies`, `synthetic`: annotation files, sources of bodies, a world with exact truth.
- `formats`, `cuboid_formats`, `labelling`: any dataset by its path; the one way to its labels.
- `label_dataset`, `batches`, `format_datasets`, ...: the Datasets, one a format, and their batches.
- `exchange`, `inspection`: files for other tools; what is in a copy of a dataset.

The names below are loaded when first used (PEP 562).
"""

if __name__ != "animal3dbox.datasets":
    raise ImportError(
        "import animal3dbox.datasets, not the folder datasets of its checkout: take the checkout's"
        " root off sys.path"
    )

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.datasets.batches import Targets as Targets
    from animal3dbox.datasets.batches import collate as collate
    from animal3dbox.datasets.batches import collate_stacked as collate_stacked
    from animal3dbox.datasets.bodies.sources import ModelBody as ModelBody
    from animal3dbox.datasets.bodies.sources import ParametersBody as ParametersBody
    from animal3dbox.datasets.bodies.sources import preset_body as preset_body
    from animal3dbox.datasets.cuboid_datasets import KittiDataset as KittiDataset
    from animal3dbox.datasets.cuboid_datasets import Omni3DDataset as Omni3DDataset
    from animal3dbox.datasets.exchange.animal3d_writer import (
        write_animal3d_fits as write_animal3d_fits,
    )
    from animal3dbox.datasets.exchange.coco_writer import write_coco as write_coco
    from animal3dbox.datasets.exchange.detection_writer import write_detections as write_detections
    from animal3dbox.datasets.exchange.fitted_animals import FittedAnimal as FittedAnimal
    from animal3dbox.datasets.exchange.kitti_writer import write_kitti as write_kitti
    from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d as write_omni3d
    from animal3dbox.datasets.exchange.oracle2d_writer import write_oracle2d as write_oracle2d
    from animal3dbox.datasets.exchange.quadruped_file import read_quadruped as read_quadruped
    from animal3dbox.datasets.exchange.quadruped_file import write_quadruped as write_quadruped
    from animal3dbox.datasets.format_datasets import Animal3DDataset as Animal3DDataset
    from animal3dbox.datasets.format_datasets import AnnotatedDataset as AnnotatedDataset
    from animal3dbox.datasets.format_datasets import CocoKeypointsDataset as CocoKeypointsDataset
    from animal3dbox.datasets.format_datasets import DeepLabCutDataset as DeepLabCutDataset
    from animal3dbox.datasets.format_datasets import MeshFolderDataset as MeshFolderDataset
    from animal3dbox.datasets.format_datasets import StanfordExtraDataset as StanfordExtraDataset
    from animal3dbox.datasets.formats import read_dataset as read_dataset
    from animal3dbox.datasets.formats import recognised_format as recognised_format
    from animal3dbox.datasets.inspection.inspect import inspect_dataset as inspect_dataset
    from animal3dbox.datasets.joined_dataset import JoinedDataset as JoinedDataset
    from animal3dbox.datasets.label_dataset import LabelDataset as LabelDataset
    from animal3dbox.datasets.labelling.file_source import FileSource as FileSource
    from animal3dbox.datasets.labelling.filters import LabelFilter as LabelFilter
    from animal3dbox.datasets.labelling.label_records import label_records as label_records
    from animal3dbox.datasets.labelling.label_requests import LabelRequest as LabelRequest
    from animal3dbox.datasets.labelling.label_requests import request_of_record as request_of_record
    from animal3dbox.datasets.labelling.load_report import LoadReport as LoadReport
    from animal3dbox.datasets.labelling.scale import AltitudeScale as AltitudeScale
    from animal3dbox.datasets.labelling.scale import KnownScale as KnownScale
    from animal3dbox.datasets.labelling.scale import SpeciesScale as SpeciesScale
    from animal3dbox.datasets.labelling.skipped import Skipped as Skipped
    from animal3dbox.datasets.read_options import ReadOptions as ReadOptions
    from animal3dbox.datasets.readers.kitti.reader import read_kitti as read_kitti
    from animal3dbox.datasets.readers.omni3d.reader import read_omni3d as read_omni3d
    from animal3dbox.datasets.readers.predictions.reader import read_predictions as read_predictions
    from animal3dbox.datasets.records import AnimalRecord as AnimalRecord
    from animal3dbox.datasets.records import CuboidRecord as CuboidRecord
    from animal3dbox.datasets.records import CuboidSet as CuboidSet
    from animal3dbox.datasets.records import RecordSet as RecordSet
    from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet as SyntheticSet
    from animal3dbox.datasets.synthetic_dataset import SyntheticDataset as SyntheticDataset

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "batches": (
            "Targets",
            "collate",
            "collate_stacked",
        ),
        "bodies.sources": (
            "ModelBody",
            "ParametersBody",
            "preset_body",
        ),
        "exchange.animal3d_writer": ("write_animal3d_fits",),
        "exchange.coco_writer": ("write_coco",),
        "exchange.fitted_animals": ("FittedAnimal",),
        "exchange.kitti_writer": ("write_kitti",),
        "exchange.detection_writer": ("write_detections",),
        "exchange.omni3d_writer": ("write_omni3d",),
        "exchange.oracle2d_writer": ("write_oracle2d",),
        "exchange.quadruped_file": ("read_quadruped", "write_quadruped"),
        "format_datasets": (
            "Animal3DDataset",
            "AnnotatedDataset",
            "CocoKeypointsDataset",
            "DeepLabCutDataset",
            "MeshFolderDataset",
            "StanfordExtraDataset",
        ),
        "formats": ("read_dataset", "recognised_format"),
        "read_options": ("ReadOptions",),
        "inspection.inspect": ("inspect_dataset",),
        "joined_dataset": ("JoinedDataset",),
        "label_dataset": ("LabelDataset",),
        "labelling.file_source": ("FileSource",),
        "labelling.filters": ("LabelFilter",),
        "labelling.label_records": ("label_records",),
        "labelling.label_requests": (
            "LabelRequest",
            "request_of_record",
        ),
        "labelling.load_report": ("LoadReport",),
        "labelling.scale": (
            "AltitudeScale",
            "KnownScale",
            "SpeciesScale",
        ),
        "labelling.skipped": ("Skipped",),
        "cuboid_datasets": ("KittiDataset", "Omni3DDataset"),
        "readers.kitti.reader": ("read_kitti",),
        "readers.omni3d.reader": ("read_omni3d",),
        "readers.predictions.reader": ("read_predictions",),
        "records": (
            "AnimalRecord",
            "CuboidRecord",
            "CuboidSet",
            "RecordSet",
        ),
        "synthetic.synthetic_set": ("SyntheticSet",),
        "synthetic_dataset": ("SyntheticDataset",),
    },
)
