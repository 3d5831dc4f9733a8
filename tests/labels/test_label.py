"""The door: label_animal."""

import math

import numpy as np
import pytest
import torch
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh
from hypothesis import given
from hypothesis import strategies as st
from rays import faces_entered
from strategies import rotations, vector
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

import animal3dbox
from animal3dbox import CuboidLabel, LabelConfig, Rejection, label_animal
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.config import Axes, Method
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import vocabulary_from_names
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

F64 = torch.float64
MESH, FACES = toy_mesh()
VIEWS = [(a, e) for a in range(0, 360, 30) for e in (-10, 0, 35, 80)]


def labelled(outcome: CuboidLabel | Rejection) -> CuboidLabel:
    assert isinstance(outcome, CuboidLabel), outcome
    return outcome


def rejected(outcome: CuboidLabel | Rejection) -> Rejection:
    assert isinstance(outcome, Rejection)
    return outcome


@pytest.mark.parametrize(
    ("azimuth", "side", "viewpoint"),
    [
        (0, "front", "front"),
        (90, "left", "left"),
        (180, "back", "back"),
        (-90, "right", "right"),
        (50, "left", "front-left"),
        (-130, "right", "back-right"),
    ],
)
def test_the_side_and_viewpoint_are_the_animals_own(
    azimuth: float, side: str, viewpoint: str
) -> None:
    label = labelled(
        label_animal(
            IMAGE_HW,
            keypoints_3d=toy_landmarks(),
            vertices=MESH,
            K=K,
            pose=camera_round(azimuth, 5),
        )
    )
    assert (label.side, label.viewpoint) == (side, viewpoint)
    assert abs(label.azimuth_deg - azimuth) < 12 or abs(abs(label.azimuth_deg) - 180) < 12


def test_an_animal_seen_from_its_left_has_its_nose_to_the_left_of_the_picture() -> None:
    label = labelled(
        label_animal(
            IMAGE_HW, keypoints_3d=toy_landmarks(), vertices=MESH, K=K, pose=camera_round(90, 0)
        )
    )
    front, back = label.corners_2d[[1, 2, 6, 5], 0].mean(), label.corners_2d[[0, 4, 7, 3], 0].mean()
    assert front < back


@pytest.mark.parametrize("method", ["basic", "default"])
@pytest.mark.parametrize("view", VIEWS)
def test_from_exact_keypoints_the_box_is_that_of_the_true_camera(
    method: Method, view: tuple[int, int]
) -> None:
    R, t = camera_round(*view)
    config = LabelConfig(method=method)
    label = labelled(
        label_animal(
            IMAGE_HW, keypoints_seen(R, t), toy_landmarks(), MESH, faces=FACES, K=K, config=config
        )
    )
    truth = labelled(
        label_animal(
            IMAGE_HW, None, toy_landmarks(), MESH, faces=FACES, K=K, pose=(R, t), config=config
        )
    )
    assert float((label.corners_2d - truth.corners_2d).abs().amax()) < 1e-3
    entered = faces_entered(truth.center.numpy(), truth.rotation.numpy(), truth.size.numpy())
    assert label.face_visible.nonzero()[:, 0].tolist() == entered


@pytest.mark.parametrize("preset", ["dog", "cat", "horse", "cow"])
@pytest.mark.parametrize("method", ["basic", "default"])
def test_a_posed_quadruped_with_its_mask_is_labelled_exactly_from_exact_keypoints(
    preset: str, method: Method
) -> None:
    model = load_quadruped()
    vertices = model.posed(
        preset_betas(preset)[None], named_pose("walk")[None], torch.zeros(1, 3, dtype=F64)
    ).vertices[0]
    landmarks = VOCABULARIES["animal3d26"].on_body(model.landmarks, vertices)
    R, t = camera_round(65, 12, distance=3.5)
    truth = labelled(
        label_animal(
            IMAGE_HW,
            None,
            None,
            vertices,
            faces=model.faces,
            template=model,
            K=K,
            pose=(R, t),
            config=LabelConfig(method=method),
        )
    )
    mask = silhouette(vertices @ R.mT + t, model.faces, K, IMAGE_HW)
    keypoints = keypoints_seen(R, t, landmarks)
    label = labelled(
        label_animal(
            IMAGE_HW,
            keypoints,
            None,
            vertices,
            faces=model.faces,
            template=model,
            K=K,
            mask=mask,
            config=LabelConfig(method=method),
        )
    )
    # A mask ends with whole pixels, which the default trusts to 0.7 px beside the keypoints' 2.
    nearly = {"basic": 1e-3, "default": 1.0}[method]
    assert float((label.corners_2d - truth.corners_2d).abs().amax()) < nearly
    assert label.quality.mask_iou is not None
    assert label.quality.mask_iou > {"basic": 0.999, "default": 0.985}[method]
    assert label.quality.orientation_rule == "torso vertices on the template"
    assert label.face_visible.nonzero()[:, 0].tolist() == faces_entered(
        truth.center.numpy(), truth.rotation.numpy(), truth.size.numpy()
    )


@thorough(1000)
@given(
    rotations(), vector(-20, 20), st.floats(0.01, 100), st.sampled_from(["default", "landmarks"])
)
def test_under_a_fixed_camera_the_box_moves_turns_and_scales_with_the_mesh(
    R_move: Tensor, shift: Tensor, factor: float, axes: Axes
) -> None:
    R, t = camera_round(40, 20)
    config = LabelConfig(axes=axes)
    here = labelled(
        label_animal(IMAGE_HW, None, toy_landmarks(), MESH, K=K, pose=(R, t), config=config)
    )
    landmarks, vertices = (
        factor * points @ R_move.mT + shift for points in (toy_landmarks(), MESH)
    )
    pose = (R @ R_move.mT, factor * t - R @ R_move.mT @ shift)
    there = labelled(
        label_animal(IMAGE_HW, None, landmarks, vertices, K=K, pose=pose, config=config)
    )
    assert_close(there.corners_3d / factor, here.corners_3d, atol=1e-9, rtol=0)
    assert_close(there.corners_2d, here.corners_2d, atol=1e-6, rtol=0)
    assert_close(
        there.cuboid_mesh.corners(),
        factor * here.cuboid_mesh.corners() @ R_move.mT + shift,
        atol=1e-9 * max(1.0, factor),
        rtol=1e-9,
    )


def test_the_corners_projected_are_the_corners_in_space() -> None:
    label = labelled(
        label_animal(
            IMAGE_HW, keypoints_3d=toy_landmarks(), vertices=MESH, K=K, pose=camera_round(33, 21)
        )
    )
    cam = label.cuboid_mesh.corners() @ label.R.mT + label.t
    assert_close(cam, label.corners_3d)
    assert_close((cam @ K.mT)[:, :2] / cam[:, 2:], label.corners_2d)
    assert all(
        x.dtype == F64
        for x in (label.corners_3d, label.corners_2d, label.face_share, label.K, label.R, label.t)
    )


def test_without_a_mesh_the_box_bounds_the_landmarks_and_says_so() -> None:
    label = labelled(
        label_animal(IMAGE_HW, keypoints_3d=toy_landmarks(), K=K, pose=camera_round(33, 21))
    )
    assert label.quality.bounds_source == "keypoints"
    assert "no mesh" in label.quality.warnings[0]
    assert bool(label.cuboid_mesh.contains(toy_landmarks()).all())


def test_an_unknown_focal_length_is_found_with_the_pose() -> None:
    R, t = camera_round(33, 21, distance=3.0)
    keypoints = keypoints_seen(R, t)
    label = labelled(label_animal(IMAGE_HW, keypoints, toy_landmarks(), MESH))
    assert label.quality.K_source == "estimated"
    sd = label.quality.log_focal_sd
    assert sd is not None
    assert 0 < sd < 0.5
    assert abs(math.log(float(label.K[0, 0] / K[0, 0]))) < 3 * sd
    assert float((label.R - R).norm()) < 0.05
    known = labelled(label_animal(IMAGE_HW, keypoints, toy_landmarks(), MESH, K=K))
    assert known.quality.log_focal_sd is None
    assert label.quality.rotation_sd_deg > known.quality.rotation_sd_deg  # type: ignore[operator]


def test_unknown_intrinsics_are_guessed_and_the_label_says_so() -> None:
    R, t = camera_round(33, 21)
    label = labelled(
        label_animal(
            IMAGE_HW,
            keypoints_seen(R, t),
            toy_landmarks(),
            MESH,
            config=LabelConfig(focal="guess"),
        )
    )
    assert label.quality.K_source == "guessed"
    assert label.K.tolist() == [[768, 0, 319.5], [0, 768, 239.5], [0, 0, 1]]  # 1.2 x 640


def test_dropping_the_tail_shortens_the_box() -> None:
    model = load_quadruped()
    kept, dropped = (
        labelled(
            label_animal(
                IMAGE_HW,
                None,
                None,
                model.v_template,
                faces=model.faces,
                template=model,
                K=K,
                pose=camera_round(60, 10),
                config=LabelConfig(tail=tail),
            )
        )
        for tail in ("keep", "drop")
    )
    assert float(dropped.size[0]) < 0.95 * float(kept.size[0])
    assert_close(dropped.size[1:], kept.size[1:], atol=0.05, rtol=0)


def test_a_camera_within_the_box_sees_no_face_and_the_label_has_no_side() -> None:
    label = labelled(
        label_animal(
            IMAGE_HW, None, toy_landmarks(), MESH, K=K, pose=camera_round(0, 0, distance=0.1)
        )
    )
    assert not label.face_visible.any()
    assert label.side is None
    assert label.behind_camera
    assert float(label.face_share.sum()) == 0


def test_landmarks_said_to_be_uncertain_pull_less() -> None:
    R, t = camera_round(50, 15)
    keypoints, sigma = keypoints_seen(R, t), torch.full((26,), 0.01, dtype=F64)
    legs = [
        i
        for i, name in enumerate(VOCABULARIES["animal3d26"].keypoints)
        if any(part in name for part in ("paw", "wrist", "hock"))
    ]
    keypoints[legs, 0] += 45  # all lower legs stand elsewhere than the body has them
    truth = labelled(label_animal(IMAGE_HW, None, toy_landmarks(), MESH, K=K, pose=(R, t)))
    plain = labelled(
        label_animal(IMAGE_HW, keypoints, toy_landmarks(), MESH, K=K, landmark_sigma=sigma)
    )
    sigma[legs] = 0.5
    told = labelled(
        label_animal(IMAGE_HW, keypoints, toy_landmarks(), MESH, K=K, landmark_sigma=sigma)
    )
    assert float((told.corners_3d - truth.corners_3d).abs().amax()) < 0.3 * float(
        (plain.corners_3d - truth.corners_3d).abs().amax()
    )


def test_missing_keypoints_never_reach_a_solver() -> None:
    R, t = camera_round(50, 15)
    keypoints = keypoints_seen(R, t)
    keypoints[:6] = 0  # missing, left at (0, 0) with visibility 0
    keypoints[6, :2] = 0  # and one that claims to be visible there
    keypoints[7] = torch.tensor([torch.nan, torch.nan, 0])
    label = labelled(
        label_animal(
            IMAGE_HW, keypoints, toy_landmarks(), MESH, K=K, config=LabelConfig(method="basic")
        )
    )
    assert label.quality.n_keypoints == 18
    assert label.quality.reprojection_error_px is not None
    assert label.quality.reprojection_error_px < 1e-3
    assert "at exactly (0, 0)" in label.quality.warnings[0]
    assert label.keypoints is not None
    assert bool(torch.isfinite(label.keypoints).all())


def test_numpy_lists_and_float32_tensors_are_taken_alike_and_left_as_they_were() -> None:
    R, t = camera_round(50, 15)
    keypoints = keypoints_seen(R, t)
    before = keypoints.clone()
    a = labelled(label_animal(IMAGE_HW, keypoints, toy_landmarks(), MESH, K=K))
    b = labelled(
        label_animal(
            IMAGE_HW, keypoints.numpy(), toy_landmarks().tolist(), MESH.numpy(), K=K.tolist()
        )
    )
    c = labelled(
        label_animal(
            IMAGE_HW, keypoints.float(), toy_landmarks().float(), MESH.float(), K=K.float()
        )
    )
    assert torch.equal(a.corners_3d, b.corners_3d)
    assert_close(a.corners_2d, c.corners_2d, atol=1e-2, rtol=0)
    assert torch.equal(before, keypoints)


def test_users_name_their_own_keypoints() -> None:
    R, t = camera_round(50, 15)
    mine = vocabulary_from_names(
        "mine", {f"my {name}": name for name in VOCABULARIES["animal3d26"].keypoints}
    )
    label = labelled(
        label_animal(IMAGE_HW, keypoints_seen(R, t), toy_landmarks(), MESH, K=K, vocabulary=mine)
    )
    assert label.side == "left"


@pytest.mark.parametrize("visible", [0, 3, 5])
def test_few_keypoints_are_rejected_with_a_reason(visible: int) -> None:
    keypoints = keypoints_seen(*camera_round(50, 15))
    keypoints[visible:, 2] = 0
    outcome = rejected(
        label_animal(IMAGE_HW, keypoints, toy_landmarks(), MESH, K=K, sample_id="dog-7")
    )
    assert outcome == Rejection(
        "dog-7", "too_few_keypoints", f"{visible} visible keypoints, but min_keypoints is 6"
    )


def test_without_keypoints_or_a_pose_there_is_a_rejection() -> None:
    assert (
        rejected(label_animal(IMAGE_HW, None, toy_landmarks(), MESH)).reason == "too_few_keypoints"
    )


def test_a_mesh_without_landmarks_or_template_has_no_sides() -> None:
    assert (
        rejected(label_animal(IMAGE_HW, vertices=MESH, K=K, pose=camera_round(0, 0))).reason
        == "no_axes"
    )


@pytest.mark.parametrize("upside", ["y up, z backward", "far behind"])
def test_an_animal_behind_its_known_camera_is_rejected(upside: str) -> None:
    R, t = (part.numpy() for part in camera_round(50, 15))
    signs = np.array([1.0, -1.0, -1.0])
    pose = (R, t - [0, 0, 9]) if upside == "far behind" else (signs[:, None] * R, signs * t)
    outcome = rejected(
        label_animal(IMAGE_HW, keypoints_3d=toy_landmarks(), vertices=MESH, K=K, pose=pose)
    )
    assert outcome.reason == "behind_camera"
    assert "OpenGL" in outcome.detail


def test_a_box_far_smaller_than_the_animal_is_rejected_as_degenerate() -> None:
    R, t = camera_round(50, 15, distance=400)
    outcome = rejected(
        label_animal(
            IMAGE_HW, keypoints_seen(R, t), toy_landmarks(), MESH, K=K, mask=np.ones(IMAGE_HW)
        )
    )
    assert outcome.reason == "degenerate_box"


NAN = float("nan")
BAD: dict[str, tuple[dict[str, object], str, str]] = {
    "image_hw of one number": ({"image_hw": (480,)}, "image_hw", "height, width"),
    "image_hw of zero": ({"image_hw": (0, 640)}, "image_hw", "> 0"),
    "keypoints of two columns": ({"keypoints_2d": np.zeros((26, 2))}, "keypoints_2d", "shape"),
    "keypoints of another vocabulary": (
        {"keypoints_2d": np.zeros((24, 3))},
        "keypoints_2d",
        "name the vocabulary",
    ),
    "a visible keypoint that is NaN": (
        {"keypoints_2d": [[NAN, 3, 1]] * 26},
        "keypoints_2d",
        "give it visibility 0",
    ),
    "a visible keypoint at infinity": (
        {"keypoints_2d": [[float("inf"), 3, 1]] * 26},
        "keypoints_2d",
        "infinite",
    ),
    "COCO's visibility 2": ({"keypoints_2d": [[5, 3, 2]] * 26}, "keypoints_2d", "COCO"),
    "a visible keypoint whose y is NaN": (
        {"keypoints_2d": [[3, NAN, 1]] * 26},
        "keypoints_2d",
        "give it visibility 0",
    ),
    "a visibility that is NaN": (
        {"keypoints_2d": [[5, 3, NAN]] * 26},
        "keypoints_2d",
        "visibility",
    ),
    "keypoints far off any image": (
        {"keypoints_2d": [[1e6, 3, 1]] * 26},
        "keypoints_2d",
        "ten image sizes",
    ),
    "keypoints that are words": ({"keypoints_2d": "left eye"}, "keypoints_2d", "numbers"),
    "landmarks of the wrong count": ({"keypoints_3d": np.zeros((5, 3))}, "keypoints_3d", "26"),
    "landmarks at infinity": (
        {"keypoints_3d": np.full((26, 3), np.inf)},
        "keypoints_3d",
        "infinite",
    ),
    "vertices with NaN": ({"vertices": [[NAN, 0, 0]] * 9}, "vertices", "finite"),
    "too few vertices": (
        {"vertices": np.zeros((3, 3)), "faces": None},
        "vertices",
        "must be a body",
    ),
    "no body at all": (
        {"vertices": None, "keypoints_3d": None},
        "vertices",
        "give vertices or keypoints_3d",
    ),
    "vertices that do not fit the template": (
        {"template": load_quadruped()},
        "vertices",
        "correspond one to one",
    ),
    "landmark deviations of the wrong count": (
        {"landmark_sigma": [0.1]},
        "landmark_sigma",
        "26 numbers",
    ),
    "negative landmark deviations": (
        {"landmark_sigma": [-0.1] * 26},
        "landmark_sigma",
        "at least 0",
    ),
    "faces out of range": ({"faces": [[0, 1, 99999]]}, "faces", "must index"),
    "K with a zero focal length": ({"K": np.diag([0.0, 1, 1])}, "K", "positive focal"),
    "K of the wrong shape": ({"K": np.eye(4)}, "K", "shape"),
    "a pose that is no pair": ({"pose": np.eye(4)}, "pose", "pair (R, t)"),
    "a pose that mirrors": ({"pose": (np.diag([1.0, 1, -1]), np.zeros(3))}, "pose", "determinant"),
    "a pose of NaN": ({"pose": (np.eye(3), [0, 0, NAN])}, "pose t", "finite"),
    "a hypothesis that is no rotation": (
        {"pose_hypotheses": [(np.ones((3, 3)), np.zeros(3))]},
        "pose_hypotheses[0]",
        "rotation",
    ),
    "an empty mask": ({"mask": np.zeros(IMAGE_HW)}, "mask", "empty"),
    "a mask of another size": ({"mask": np.ones((640, 480))}, "mask", "image's size"),
    "a mask of NaN": ({"mask": np.full(IMAGE_HW, NAN)}, "mask", "finite"),
    "a lens of three numbers": ({"distortion": [0.1, 0, 0]}, "distortion", "OpenCV's order"),
    "a normalised K": ({"K": [[0.9, 0, 0.5], [0, 1.2, 0.5], [0, 0, 1]]}, "K", "normalised"),
    "a lens of NaN": ({"distortion": [NAN] * 4}, "distortion", "finite"),
    "tail dropped without a template": ({"config": LabelConfig(tail="drop")}, "template", "tail"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_arguments_are_refused_naming_sample_and_field(case: str) -> None:
    change, field, says = BAD[case]
    good = {
        "image_hw": IMAGE_HW,
        "keypoints_2d": keypoints_seen(*camera_round(9, 9)),
        "keypoints_3d": toy_landmarks(),
        "vertices": MESH,
        "faces": FACES,
        "K": K,
    }
    good |= change
    with pytest.raises(SampleError) as caught:
        label_animal(**good, sample_id="zebra-12")  # type: ignore[arg-type]
    assert caught.value.sample_id == "zebra-12"
    assert field in caught.value.field
    assert says in str(caught.value)
    assert str(caught.value).startswith("zebra-12: ")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"method": "magic"}, "method must be one of default, paper, basic"),
        ({"axes": "nose"}, "axes"),
        ({"residual": "cubed"}, "residual"),
        ({"tail": "wag"}, "tail"),
        ({"mask_box": "round"}, "mask_box"),
        ({"min_keypoints": 3}, "min_keypoints"),
        ({"lambda_keypoints": 1.5}, "lambda_keypoints"),
        ({"focal_guess": 0.0}, "focal_guess"),
        ({"margin": -1.0}, "margin"),
        ({"xtol": NAN}, "xtol"),
    ],
)
def test_impossible_options_are_refused(options: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        LabelConfig(**options)  # type: ignore[arg-type]


def test_an_unknown_vocabulary_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="animal3d26, stanfordextra24"):
        label_animal(IMAGE_HW, keypoints_3d=toy_landmarks(), vocabulary="unicorn12")


def test_the_package_offers_its_doors_lazily_and_nothing_else() -> None:
    assert animal3dbox.label_animal is label_animal
    assert "label_animal" in dir(animal3dbox)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = animal3dbox.nonsense
