"""Labels and records of cuboids as targets of one animal each, in float64, for the checks."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import SampleError
from animal3dbox.labels.flank import FLANKS
from animal3dbox.report.label_files import AnimalRow
from animal3dbox.target_schema import FILE_FIELDS


def target_of_row(row: AnimalRow) -> dict[str, Any]:
    """The target of one label; its box clipped to the frame, as a Dataset gives it.

    Raises:
        SampleError: a field has rows of different lengths.

    Example:
        >>> from animal3dbox import LabelConfig, label_animal
        >>> label = label_animal(
        ...     image_hw=(120, 160),
        ...     vertices=[[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (-0.4, 0.4)],
        ...     K=[[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]],
        ...     pose=([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 5]),
        ...     config=LabelConfig(axes="pca"),
        ... )
        >>> from animal3dbox.report import animal_row
        >>> target = target_of_row(animal_row(label, image="a.jpg", animal=0, category="dog"))
        >>> tuple(target["corners_3d"].shape), target["face_visible"][0].nonzero().ravel().tolist()
        ((1, 8, 3), [3])
    """
    target: dict[str, Any] = {"image_id": row.sample_id}
    for field in FILE_FIELDS:
        value = getattr(row, field.label_name or field.name)
        if field.name == "corners_2d":  # what is not in front of the camera has no meaning
            value = [[0.0, 0.0] if px is None else px for px in value]
        if value is None or field.name == "boxes":
            continue
        tensor = torch.tensor(value) if field.kind == "flag" else _tensor(row, field.name, value)
        target[field.name] = tensor if field.per == "image" else tensor[None]
    if row.flank is not None:
        target["flank"] = torch.tensor([FLANKS.index(row.flank)])
    target["corner_in_front"] = torch.tensor([[px is not None for px in row.corners_2d]])
    if row.distortion is not None:
        target["distortion"] = _tensor(row, "distortion", row.distortion)
    box = _tensor(row, "box", row.box)
    target["boxes"] = _clipped(box, row.image_hw)[None] if box.shape == (4,) else box[None]
    return target


def target_of_record(record: CuboidRecord) -> dict[str, Any]:
    """The target of one box as a dataset states it."""
    target: dict[str, Any] = {
        "image_id": record.sample_id,
        "K": torch.from_numpy(np.ascontiguousarray(record.K)),
    }
    for name, value in (
        ("center", record.center),
        ("rotation", record.rotation),
        ("size", record.size),
    ):
        target[name] = torch.from_numpy(np.ascontiguousarray(value))[None]
    if record.truncation is not None:
        target["truncation"] = torch.tensor([record.truncation], dtype=torch.float64)
    if record.box is not None:
        target["boxes"] = _clipped(torch.from_numpy(record.box), record.image_hw)[None]
    return target


def _tensor(row: AnimalRow, name: str, value: object) -> Tensor:
    try:
        return torch.tensor(value, dtype=torch.float64)
    except ValueError as error:
        raise SampleError(row.sample_id, name, "has rows of different lengths") from error


def _clipped(box: Tensor, image_hw: tuple[int, int]) -> Tensor:
    """The part of a box in the frame.

    The box itself if there is none, which the checks will tell.
    """
    height, width = image_hw
    last = torch.tensor([width - 0.5, height - 0.5] * 2, dtype=torch.float64)
    inside = torch.minimum(torch.maximum(box.double(), torch.full_like(last, -0.5)), last)
    return inside if bool((inside[2:] > inside[:2]).all()) else box.double()
