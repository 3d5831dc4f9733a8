"""Few boxes are mapped in plain numbers, many by NumPy and torch: they are the same boxes."""

import numpy as np
import pytest
import torch

from animal3dbox.transforms.camera_law.boxes import FEW, mapped_boxes

HW = (60, 80)


@pytest.mark.parametrize("perspective", [0, 2e-2, 1e-1])
@pytest.mark.parametrize("outlined", [False, True])
def test_few_boxes_are_mapped_as_many_are(perspective: float, outlined: bool) -> None:
    rng = np.random.default_rng(0)
    count, beyond = 40, 0
    for _ in range(20):
        H = np.eye(3) + np.concatenate((rng.normal(0, 0.4, (2, 3)), np.zeros((1, 3))))
        H[2, :2] = rng.normal(0, perspective, 2)
        boxes = rng.uniform(-20, 90, (count, 2, 2))
        boxes = np.concatenate((boxes.min(1), boxes.max(1)), axis=1)
        around = rng.uniform(-20, 90, (count, 2, 2))
        outline = np.concatenate((around.min(1), around.max(1)), axis=1), rng.random(count) < 0.7
        many = mapped_boxes(boxes, H, HW, outline if outlined else None)
        tensors = (torch.from_numpy(outline[0]), torch.from_numpy(outline[1]))
        in_torch = mapped_boxes(
            torch.from_numpy(boxes), torch.from_numpy(H), HW, tensors if outlined else None
        )
        np.testing.assert_allclose(in_torch.numpy(), many, atol=1e-12)
        for first in range(0, count, FEW):
            rows = slice(first, first + FEW)
            few_outlines = (outline[0][rows], outline[1][rows]) if outlined else None
            few = mapped_boxes(boxes[rows], H, HW, few_outlines)
            np.testing.assert_allclose(few, many[rows], atol=1e-12)
        beyond += int(((boxes[:, :2] @ H[2, :2] + 1) <= 0).sum())
    assert perspective == 0 or beyond > 10


def test_no_box_stays_no_box() -> None:
    assert mapped_boxes(np.zeros((0, 4)), np.eye(3), HW, None).shape == (0, 4)
