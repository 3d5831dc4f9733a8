"""Annotated animals as torch Datasets whose labels are made on the way.

The names below are loaded when first used (PEP 562).
"""

if __name__ != "animal3dbox.datasets":
    raise ImportError(
        "import animal3dbox.datasets, not the folder datasets of its checkout: take the checkout's"
        " root off sys.path"
    )

from importlib import import_module
from typing import TYPE_CHECKING, Any

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

_HOMES = {
    "AltitudeScale": "labelling.scale",
    "Animal3DDataset": "format_datasets",
    "AnnotatedDataset": "format_datasets",
    "CocoKeypointsDataset": "format_datasets",
    "DeepLabCutDataset": "format_datasets",
    "KnownScale": "labelling.scale",
    "LabelDataset": "label_dataset",
    "LabelFilter": "labelling.filters",
    "MeshFolderDataset": "format_datasets",
    "Omni3DDataset": "format_datasets",
    "Skipped": "label_dataset",
    "SpeciesScale": "labelling.scale",
    "StanfordExtraDataset": "format_datasets",
    "SyntheticDataset": "format_datasets",
    "SyntheticSet": "synthetic.synthetic_set",
    "collate": "batches",
    "collate_stacked": "batches",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'animal3dbox.datasets' has no attribute {name!r}")
    return getattr(import_module(f"animal3dbox.datasets.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
