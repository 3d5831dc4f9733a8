"""Labels of pictures that a lens bends."""

import cv2
import numpy as np
import pytest
import torch
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh
from torch import Tensor
from torch.testing import assert_close

from animal3dbox import CuboidLabel, LabelConfig, Rejection, label_animal
from animal3dbox.geometry.distortion import bent_points
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.config import Method
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

F64 = torch.float64
MESH, FACES = toy_mesh()
LENSES = {
    "barrel": [-0.3, 0.1, 0.001, -0.002],
    "pincushion": [0.25, 0.08, -0.002, 0.003, 0.01],
    "rational": [0.4, -0.1, 0.001, 0.002, 0.02, 0.7, 0.05, 0.01],
    "prism": [-0.2, 0.05, 0.003, -0.001, 0.01, 0.05, 0.01, 0.0, 0.01, -0.002, 0.008, 0.003],
}


def labelled(outcome: CuboidLabel | Rejection) -> CuboidLabel:
    assert isinstance(outcome, CuboidLabel), outcome
    return outcome


def seen_by_opencv(points: Tensor, R: Tensor, t: Tensor, lens: list[float]) -> Tensor:
    px, _ = cv2.projectPoints(
        points.numpy(), cv2.Rodrigues(R.numpy())[0], t.numpy(), K.numpy(), np.array(lens)
    )
    return torch.from_numpy(px[:, 0])


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("azimuth", [20, 110, 250])
def test_a_label_of_a_known_camera_is_where_opencv_puts_the_box(lens: str, azimuth: int) -> None:
    R, t = camera_round(azimuth, 15)
    label = labelled(
        label_animal(
            IMAGE_HW,
            None,
            toy_landmarks(),
            MESH,
            faces=FACES,
            K=K,
            pose=(R, t),
            distortion=LENSES[lens],
        )
    )
    expected = seen_by_opencv(label.cuboid_mesh.corners(), R, t, LENSES[lens])
    assert_close(label.corners_2d, expected, atol=1e-6, rtol=0)
    vertices = seen_by_opencv(MESH, R, t, LENSES[lens])
    assert_close(label.box, torch.cat((vertices.amin(0), vertices.amax(0))), atol=1e-6, rtol=0)
    front = cv2.contourArea(expected[[1, 2, 6, 5]].float().numpy())
    assert float(label.face_area[0]) == pytest.approx(
        front if label.face_visible[0] else 0.0, rel=1e-4
    )
    assert label.distortion is not None
    assert label.distortion.tolist() == LENSES[lens]


@pytest.mark.parametrize("method", ["basic", "paper", "default"])
@pytest.mark.parametrize("lens", LENSES)
def test_from_exact_keypoints_under_a_lens_the_box_is_that_of_the_true_camera(
    lens: str, method: Method
) -> None:
    R, t = camera_round(40, 20)
    keypoints = torch.cat(
        (seen_by_opencv(toy_landmarks(), R, t, LENSES[lens]), torch.ones(26, 1, dtype=F64)), dim=1
    )
    config = LabelConfig(method=method)
    label = labelled(
        label_animal(
            IMAGE_HW,
            keypoints,
            toy_landmarks(),
            MESH,
            faces=FACES,
            K=K,
            config=config,
            distortion=LENSES[lens],
        )
    )
    assert_close(
        label.corners_2d,
        seen_by_opencv(label.cuboid_mesh.corners(), R, t, LENSES[lens]),
        atol=1e-6,
        rtol=0,
    )
    assert label.quality.reprojection_error_px is not None
    assert label.quality.reprojection_error_px < 1e-6


@pytest.mark.parametrize("given", [True, False])
def test_a_lens_of_zeros_changes_nothing(given: bool) -> None:
    R, t = camera_round(40, 20)
    keypoints = keypoints_seen(R, t)
    keypoints[:, :2] += torch.randn(26, 2, generator=torch.Generator().manual_seed(1), dtype=F64)
    mask = silhouette(MESH @ R.mT + t, FACES, K, IMAGE_HW)
    pose = (R, t) if given else None
    a, b = (
        labelled(
            label_animal(
                IMAGE_HW,
                keypoints,
                toy_landmarks(),
                MESH,
                faces=FACES,
                K=K,
                mask=mask,
                pose=pose,
                distortion=lens,
            )
        )
        for lens in (None, [0.0] * 5)
    )
    for field in (
        "corners_3d",
        "corners_2d",
        "face_area",
        "face_share",
        "box",
        "surface_share",
        "R",
        "t",
    ):
        assert_close(getattr(b, field), getattr(a, field), atol=1e-6, rtol=1e-7)
    assert (
        b.quality == a.quality
        or abs((b.quality.reprojection_error_px or 0) - (a.quality.reprojection_error_px or 0))
        < 1e-7
    )


def test_the_mask_of_a_bent_picture_helps_and_is_compared_bent() -> None:
    model, lens = load_quadruped(), torch.tensor([-0.25, 0.05, 0.0, 0.0], dtype=F64)
    R, t = camera_round(60, 15, distance=2.5)
    t = t + torch.tensor([0.3, 0.15, 0], dtype=F64)
    mask = silhouette(bent_points(model.v_template @ R.mT + t, lens), model.faces, K, IMAGE_HW)
    landmarks = model.keypoints(model.v_template)
    keypoints = torch.cat(
        (seen_by_opencv(landmarks, R, t, lens.tolist()), torch.ones(26, 1, dtype=F64)), dim=1
    )
    keypoints[:, :2] += 4 * torch.randn(
        26, 2, generator=torch.Generator().manual_seed(0), dtype=F64
    )
    with_mask, without = (
        labelled(
            label_animal(
                IMAGE_HW,
                keypoints,
                landmarks,
                model.v_template,
                faces=model.faces,
                template=model,
                K=K,
                mask=m,
                distortion=lens,
            )
        )
        for m in (mask, None)
    )
    true = labelled(
        label_animal(
            IMAGE_HW,
            keypoints,
            None,
            model.v_template,
            faces=model.faces,
            template=model,
            K=K,
            mask=mask,
            distortion=lens,
            pose=(R, t),
        )
    )
    assert true.quality.mask_iou == 1
    straight = labelled(
        label_animal(
            IMAGE_HW,
            None,
            None,
            model.v_template,
            faces=model.faces,
            template=model,
            K=K,
            pose=(R, t),
        )
    )
    assert_close(true.surface_share, straight.surface_share, atol=0.02, rtol=0)
    assert with_mask.quality.mask_iou is not None
    assert with_mask.quality.mask_iou > 0.9
    off = [
        float((label.corners_2d - true.corners_2d).norm(dim=-1).mean())
        for label in (with_mask, without)
    ]
    assert off[0] < off[1]


def test_an_animal_beyond_the_lens_is_rejected_and_not_folded_back_into_the_picture() -> None:
    R, t = camera_round(60, 15)
    outcome = label_animal(
        IMAGE_HW,
        None,
        toy_landmarks(),
        MESH,
        faces=FACES,
        K=K,
        pose=(R, t + torch.tensor([4.0, 0, 0])),
        distortion=[-0.3, 0.0, 0.0, 0.0],
        sample_id="far",
    )
    assert isinstance(outcome, Rejection)
    assert (outcome.sample_id, outcome.reason) == ("far", "beyond_lens")


def test_keypoints_where_the_lens_shows_nothing_do_not_count_and_the_label_says_so() -> None:
    R, t = camera_round(40, 20)
    lens = [-0.9, 0.0, 0.0, 0.0]  # shows nothing beyond 0.41 x focal from the centre
    keypoints = torch.cat(
        (
            seen_by_opencv(toy_landmarks(), R, t + torch.tensor([0, 0, 3.0]), lens),
            torch.ones(26, 1, dtype=F64),
        ),
        dim=1,
    )
    keypoints[4, :2] = torch.tensor([635.0, 4.0])
    label = labelled(
        label_animal(IMAGE_HW, keypoints, toy_landmarks(), MESH, faces=FACES, K=K, distortion=lens)
    )
    warnings = label.quality.warnings
    assert any("1 keypoints lie where the lens shows nothing" in warning for warning in warnings)
    assert (label.quality.n_keypoints, label.quality.n_inliers) == (26, 25)
    assert float(rotation_angle(label.R, R)) < 1e-6
