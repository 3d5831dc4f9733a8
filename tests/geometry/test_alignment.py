import math

import torch
from torch.testing import assert_close

from animal3dbox.geometry.rigid_transforms import alignment_variation


def test_alignment_variation_is_one_minus_the_cosine_and_keeps_tiny_angles() -> None:
    x, y = (
        torch.tensor([2.0, 0, 0], dtype=torch.float64),
        torch.tensor([0.0, 3, 0], dtype=torch.float64),
    )
    assert float(alignment_variation(x, x)) == 0
    assert_close(float(alignment_variation(x, y)), 1.0)
    assert_close(float(alignment_variation(x, -x)), 2.0)
    tiny = torch.tensor([math.cos(1e-9), math.sin(1e-9), 0], dtype=torch.float64)
    assert_close(float(alignment_variation(x, tiny)), 5e-19, rtol=1e-6, atol=0)
