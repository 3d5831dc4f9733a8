"""Annotated animals as torch Datasets whose labels are made on the way.

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
    from animal3dbox.datasets.batches import collate as collate
    from animal3dbox.datasets.batches import collate_stacked as collate_stacked
    from animal3dbox.datasets.format_datasets import Animal3DDataset as Animal3DDataset
    from animal3dbox.datasets.format_datasets import AnnotatedDataset as AnnotatedDataset
    from animal3dbox.datasets.format_datasets import CocoKeypointsDataset as CocoKeypointsDataset
    from animal3dbox.datasets.format_datasets import DeepLabCutDataset as DeepLabCutDataset
    from animal3dbox.datasets.format_datasets import MeshFolderDataset as MeshFolderDataset
    from animal3dbox.datasets.format_datasets import Omni3DDataset as Omni3DDataset
    from animal3dbox.datasets.format_datasets import StanfordExtraDataset as StanfordExtraDataset
    from animal3dbox.datasets.format_datasets import SyntheticDataset as SyntheticDataset
    from animal3dbox.datasets.label_dataset import LabelDataset as LabelDataset
    from animal3dbox.datasets.label_dataset import Skipped as Skipped
    from animal3dbox.datasets.labelling.filters import LabelFilter as LabelFilter
    from animal3dbox.datasets.labelling.scale import AltitudeScale as AltitudeScale
    from animal3dbox.datasets.labelling.scale import KnownScale as KnownScale
    from animal3dbox.datasets.labelling.scale import SpeciesScale as SpeciesScale
    from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet as SyntheticSet

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "batches": ("collate", "collate_stacked"),
        "format_datasets": (
            "Animal3DDataset",
            "AnnotatedDataset",
            "CocoKeypointsDataset",
            "DeepLabCutDataset",
            "MeshFolderDataset",
            "Omni3DDataset",
            "StanfordExtraDataset",
            "SyntheticDataset",
        ),
        "label_dataset": ("LabelDataset", "Skipped"),
        "labelling.filters": ("LabelFilter",),
        "labelling.scale": ("AltitudeScale", "KnownScale", "SpeciesScale"),
        "synthetic.synthetic_set": ("SyntheticSet",),
    },
)
