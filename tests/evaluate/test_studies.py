"""The evaluation's protocols: each measures what it says."""

import pytest
import torch
from torch.testing import assert_close

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.datasets.synthetic.world.config import CLEAR
from animal3dbox.errors import ConfigError
from animal3dbox.evaluate.accuracy import NAMED, accuracy_rows, accuracy_table, remeshed
from animal3dbox.evaluate.config import EvaluateConfig
from animal3dbox.evaluate.face_study import FaceRow, face_rows, seen_by_rays, window_shares
from animal3dbox.evaluate.face_views import BEHIND, CLASSES, draw_view
from animal3dbox.evaluate.orientation import (
    RULES,
    float32_angle_deg,
    stability_rows,
    stability_table,
)
from animal3dbox.evaluate.pose_study import depth_flip, pose_rows, pose_table
from animal3dbox.evaluate.reproduction import DROPPED, FED, PARTS, reproduction_rows
from animal3dbox.evaluate.subject import Subject, subject
from animal3dbox.geometry.box_visibility import corners_in_front, face_visibility
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.cuboid import FACE_NAMES, Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle

F64 = torch.float64
CONFIG = EvaluateConfig(animals=2, world=CLEAR)


@pytest.fixture(scope="module")
def someone() -> Subject:
    return subject(CONFIG, 1)


@pytest.fixture(scope="module")
def views() -> list[FaceRow]:
    return [row for index in range(3) for row in face_rows(subject(EvaluateConfig(), index))]


def test_an_evaluation_of_nobody_is_refused() -> None:
    with pytest.raises(ConfigError, match="animals and every"):
        EvaluateConfig(animals=0)


def test_what_is_said_of_a_subject_has_the_body_in_the_camera_frame_and_no_pose(
    someone: Subject,
) -> None:
    annotated = someone.annotated(FaultConfig())
    assert_close(annotated.vertices, someone.animal.vertices_cam, rtol=0, atol=1e-9)


def test_noise_on_image_keypoints_alone_turns_no_axes_in_the_bodys_frame_and_all_in_the_cameras(
    someone: Subject,
) -> None:
    rows = stability_rows(someone)
    still = [row.theta_deg for row in rows if row.protocol == "image"]
    assert len(still) == 5 * len(RULES)
    assert max(still) < 1e-9
    moving = [
        row.theta_deg for row in rows if row.protocol == "camera" and row.rule == "ours, mesh"
    ]
    assert len(moving) == 5
    assert 0.05 < max(moving) < 40
    loud = [
        row.theta_deg
        for row in rows
        if row.protocol == "model units" and row.rule == "landmarks (paper)"
    ]
    assert max(loud) > 45
    on_mesh, on_landmarks = (
        max(r.theta_deg for r in rows if (r.protocol, r.rule) == ("pixel-equivalent", rule))
        for rule in ("ours, mesh", "ours, landmarks")
    )
    assert 0 < on_mesh < on_landmarks
    published = [row for row in stability_table(rows).rows if "PAPER" in str(row[0])]
    assert [row[7] for row in published] == [120.68, 0.0046]


def test_the_papers_formula_in_float32_sees_turns_where_there_are_none() -> None:
    angles = torch.linspace(0.1, 3, 200, dtype=F64)[:, None] * torch.nn.functional.normalize(
        torch.tensor([0.3, -0.5, 0.8], dtype=F64), dim=0
    )
    floor = torch.tensor([float32_angle_deg(R, R) for R in rotation_from_axis_angle(angles)])
    assert 1e-3 < float(floor.mean()) < 0.05
    turned = rotation_from_axis_angle(torch.tensor([0.5, 0.0, 0.0], dtype=F64))
    assert float32_angle_deg(turned, torch.eye(3, dtype=F64)) == pytest.approx(28.6479, abs=1e-3)


def test_accuracy_knows_a_front_from_a_back_where_principal_components_do_not(
    someone: Subject,
) -> None:
    rows = {row.rule: row for row in accuracy_rows(someone)}
    assert rows["ours, mesh"].angle_deg < 10
    assert rows["ours, re-meshed"].angle_deg < 15
    assert rows[NAMED].angle_deg <= rows["pca of mesh"].angle_deg + 1e-9
    assert 0.5 < (rows["ours, re-meshed"].iou3d or 0) < 1
    assert someone.animal.pose in accuracy_table(list(rows.values())).columns


def test_a_remeshed_body_is_another_mesh_of_nearly_the_same_extent() -> None:
    animal = synthetic_animal(0, 1)
    vertices, faces, landmarks = remeshed(animal.vertices, animal.model.faces, animal.landmarks)
    assert 100 < len(vertices) < animal.model.vertex_count
    assert int(faces.max()) < len(vertices)
    assert len(faces)
    size = float(torch.linalg.vector_norm(animal.vertices.amax(0) - animal.vertices.amin(0)))
    assert_close(vertices.amax(0), animal.vertices.amax(0), rtol=0, atol=0.03 * size)
    assert float(torch.cdist(landmarks, vertices).amin(1).amax()) < 1e-6


def test_a_turn_by_half_about_the_vertical_is_a_depth_flip_and_a_small_one_is_not() -> None:
    truth = rotation_from_axis_angle(torch.tensor([0.1, 0.4, -0.2], dtype=F64))
    for angle, flips in ((torch.pi, True), (0.3, False)):
        assert (
            depth_flip(
                rotation_from_axis_angle(torch.tensor([0.0, angle, 0.0], dtype=F64)) @ truth, truth
            )
            is flips
        )


def test_without_faults_every_pose_but_the_papers_squared_one_is_exact(someone: Subject) -> None:
    rows = {row.method: row for row in pose_rows(someone, {"no fault": FaultConfig()})}
    assert list(rows) == ["basic", "paper (vector)", "paper (literal)", "default"]
    for method in ("basic", "default"):
        row = rows[method]
        assert row.reason is None
        assert row.clean_px is not None
        # The default trusts the mask, which ends with whole pixels, beside the keypoints.
        assert row.clean_px < {"basic": 1e-3, "default": 0.7}[method]
        assert row.iou3d is not None
        assert row.iou3d > 0.6
    assert rows["paper (vector)"].annotated_px is not None
    assert pose_table(list(rows.values())).rows[0][:4] == ("no fault", "basic", 1, 1)


def test_outliers_count_in_the_annotated_error_and_not_in_the_clean_one(someone: Subject) -> None:
    row = next(
        r
        for r in pose_rows(someone, {"2 px, 30 % outliers": FaultConfig(noise_px=2, outliers=0.3)})
        if r.method == "default"
    )
    assert row.annotated_px is not None
    assert row.clean_px is not None
    assert row.annotated_px > 3 * row.clean_px


def test_keypoints_at_zero_ruin_the_error_where_they_are_fed_and_not_where_they_are_dropped(
    someone: Subject,
) -> None:
    rows = reproduction_rows(someone)
    assert len(rows) == len(PARTS) * (len(FED) + len(DROPPED))
    worst = {
        fed: max(row.error_px for row in rows if row.fed is fed and row.error_px is not None)
        for fed in (True, False)
    }
    assert worst[True] > 20
    assert worst[False] < 5


@pytest.mark.parametrize("view", CLASSES)
def test_shares_and_booleans_of_faces_are_what_rays_find(view: str, views: list[FaceRow]) -> None:
    rows = [row for row in views if row.view == view]
    assert len(rows) == 3
    for row in rows:
        assert row.booleans_right == 6
        assert row.share_in_image_error <= 0.01
        assert (row.share_error is None) == (view == BEHIND)
        assert row.share_error is None or row.share_error <= 0.01


def test_a_view_is_of_its_class(someone: Subject) -> None:
    box, vertices = someone.animal.cuboid_world, someone.animal.vertices
    cuts = {}
    for view in CLASSES:
        camera = draw_view(view, box, vertices, seed=3, index=5)
        assert camera is not None
        box_cam = box.transformed(camera.T_cam_world)
        assert bool(corners_in_front(box_cam).all()) == (view != BEHIND)
        cuts[view] = float(face_visibility(box_cam, camera.K, camera.image_hw).truncation)
        if view == "UAV nadir":
            assert (
                float(camera.T_cam_world[2, 2]) < -0.98
            )  # the optical axis, in the world, points down
    assert cuts["in frame"] == 0 < cuts["truncated"]


def test_a_box_straight_ahead_shows_its_front_to_the_rays_by_hand() -> None:
    columns = torch.tensor([[0.0, 0, -1], [1.0, 0, 0], [0.0, -1, 0]], dtype=F64).T.contiguous()
    box = Cuboid(torch.tensor([0.0, 0, 4], dtype=F64), columns, torch.ones(3, dtype=F64))
    assert seen_by_rays(box).tolist() == [name == "front" for name in FACE_NAMES]
    assert window_shares(box, intrinsics(60.0, (60, 80)), (60, 80), True).tolist() == [
        1.0,
        0,
        0,
        0,
        0,
        0,
    ]
