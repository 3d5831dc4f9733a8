"""Annotated animals as torch Datasets whose labels are made on the way.

The names below are loaded when first used (PEP 562).
"""

if __name__ != "animal3dbox.datasets":
    raise ImportError("import animal3dbox.datasets, not the folder datasets of its checkout: take the checkout's root off sys.path")

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from animal3dbox.datasets.batches import collate as collate
    from animal3dbox.datasets.batches import collate_stacked as collate_stacked
    from animal3dbox.datasets.by_format import Animal3DDataset as Animal3DDataset
    from animal3dbox.datasets.by_format import AnnotatedDataset as AnnotatedDataset
    from animal3dbox.datasets.by_format import CocoKeypointsDataset as CocoKeypointsDataset
    from animal3dbox.datasets.by_format import DeepLabCutDataset as DeepLabCutDataset
    from animal3dbox.datasets.by_format import MeshFolderDataset as MeshFolderDataset
    from animal3dbox.datasets.by_format import Omni3DDataset as Omni3DDataset
    from animal3dbox.datasets.by_format import StanfordExtraDataset as StanfordExtraDataset
    from animal3dbox.datasets.by_format import SyntheticDataset as SyntheticDataset
    from animal3dbox.datasets.filters import LabelFilter as LabelFilter
    from animal3dbox.datasets.label_dataset import LabelDataset as LabelDataset
    from animal3dbox.datasets.label_dataset import Skipped as Skipped
    from animal3dbox.datasets.scale import AltitudeScale as AltitudeScale
    from animal3dbox.datasets.scale import KnownScale as KnownScale
    from animal3dbox.datasets.scale import SpeciesScale as SpeciesScale
    from animal3dbox.datasets.synthetic_set import SyntheticSet as SyntheticSet

_HOMES = {
    "AltitudeScale": "scale", "Animal3DDataset": "by_format", "AnnotatedDataset": "by_format", "CocoKeypointsDataset": "by_format",
    "DeepLabCutDataset": "by_format", "KnownScale": "scale", "LabelDataset": "label_dataset", "LabelFilter": "filters",
    "MeshFolderDataset": "by_format", "Omni3DDataset": "by_format", "Skipped": "label_dataset", "SpeciesScale": "scale",
    "StanfordExtraDataset": "by_format", "SyntheticDataset": "by_format", "SyntheticSet": "synthetic_set", "collate": "batches",
    "collate_stacked": "batches",
}  # fmt: skip

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'animal3dbox.datasets' has no attribute {name!r}")
    return getattr(import_module(f"animal3dbox.datasets.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
