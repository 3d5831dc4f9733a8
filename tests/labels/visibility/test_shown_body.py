"""What is drawn, and what is not."""

import pytest
import torch
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh
from torch import Tensor
from torch.testing import assert_close

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.geometry import visible_surface as seen_surface
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.pixel_boxes import mask_box
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.visibility import body_in_picture as shown_body

MESH, FACES = toy_mesh()
QUICK = LabelConfig(surface_share=False, mask_iou=False)


def label_of(
    R: Tensor, t: Tensor, mask: Tensor | None = None, config: LabelConfig = QUICK
) -> CuboidLabel:
    label = label_animal(
        IMAGE_HW,
        keypoints_seen(R, t),
        toy_landmarks(),
        MESH,
        faces=FACES,
        K=K,
        pose=(R, t),
        mask=mask,
        config=config,
    )
    assert isinstance(label, CuboidLabel)
    return label


@pytest.mark.parametrize("masked", [True, False])
def test_a_label_without_measured_surface_and_overlap_draws_nothing_and_is_else_the_same(
    masked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    R, t = camera_round(50, 15)
    mask = silhouette(MESH @ R.mT + t, FACES, K, IMAGE_HW) if masked else None
    full = label_of(R, t, mask, LabelConfig())
    monkeypatch.delattr(shown_body, "covered_part")
    monkeypatch.delattr(seen_surface, "rasterize")
    quick = label_of(R, t, mask)
    assert full.surface_share is not None
    assert (full.quality.mask_iou is None) == (not masked)
    assert quick.surface_share is None
    assert quick.quality.mask_iou is None
    for field in (
        "corners_3d",
        "corners_2d",
        "face_area",
        "face_share",
        "face_share_in_image",
        "box",
        "keypoints",
    ):
        assert torch.equal(getattr(quick, field), getattr(full, field))


@pytest.mark.parametrize("config", [LabelConfig(mask_iou=False), LabelConfig(surface_share=False)])
def test_surface_and_overlap_are_switched_apart(config: LabelConfig) -> None:
    R, t = camera_round(50, 15)
    label = label_of(R, t, silhouette(MESH @ R.mT + t, FACES, K, IMAGE_HW), config)
    assert (label.surface_share is not None, label.quality.mask_iou is not None) == (
        config.surface_share,
        config.mask_iou,
    )


def test_the_box_without_a_mask_bounds_the_mesh_exactly() -> None:
    R, t = camera_round(50, 15)
    px, _ = project(K, MESH @ R.mT + t)
    assert_close(label_of(R, t).box, torch.cat((px.amin(0), px.amax(0))), atol=1e-9, rtol=0)


@pytest.mark.parametrize("shift", [(0.0, 1.2), (1.0, 0.8), (-1.6, 0.0), (0.0, -1.0)])
def test_the_box_of_a_mesh_that_the_frame_cuts_bounds_what_is_left_of_it(
    shift: tuple[float, float],
) -> None:
    R, t = camera_round(50, 15, distance=3)
    t = t + torch.tensor([*shift, 0])
    fine = (
        torch.tensor([[8.0, 0, 3.5], [0, 8, 3.5], [0, 0, 1]], dtype=torch.float64) @ K
    )  # eight pixels for one
    fine_hw = (8 * IMAGE_HW[0], 8 * IMAGE_HW[1])
    drawn = torch.from_numpy(mask_box(silhouette(MESH @ R.mT + t, FACES, fine, fine_hw)))
    px, _ = project(K, MESH @ R.mT + t)
    box = label_of(R, t).box
    assert float((box - torch.cat((px.amin(0), px.amax(0)))).abs().amax()) > 20  # cut
    assert_close(box, (drawn + 0.5) / 8 - 0.5, atol=0.4, rtol=0)


def test_the_box_of_a_mesh_around_the_camera_is_drawn() -> None:
    R, t = camera_round(50, 15, distance=0.3)
    assert float((MESH @ R.mT + t)[:, 2].amin()) < 0
    label = label_animal(
        IMAGE_HW, None, toy_landmarks(), MESH, faces=FACES, K=K, pose=(R, t), config=QUICK
    )
    assert isinstance(label, CuboidLabel)
    drawn = mask_box(silhouette(MESH @ R.mT + t, FACES, K, IMAGE_HW))
    assert label.box.tolist() == drawn.tolist()
