"""The law over random scenes and chains of transforms, in float64, against recomputation."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from mapped_targets import final_hw, mapped
from scenes import KEYPOINT_MIRROR, scene, scenes
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import SampleError
from animal3dbox.geometry.box_visibility import corners_in_front, face_visibility
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import MIRRORED_CORNERS, MIRRORED_FACES, Cuboid
from animal3dbox.geometry.homography import apply_homography, update_camera
from animal3dbox.transforms import (
    CenterCrop,
    Compose,
    LetterBox,
    PadTo,
    RandomAffine,
    RandomHorizontalFlip,
    RandomPerspective,
    RandomResizedCrop,
    RandomRotation,
    RandomVerticalFlip,
    RandomVirtualCamera,
    Resize,
    Transform,
)
from animal3dbox.transforms.camera_law.law import map_fields
from animal3dbox.transforms.camera_law.relabel import Relabelling
from animal3dbox.transforms.camera_law.target_dict import read_target
from animal3dbox.transforms.steps import Plan

F64 = torch.float64


Scene = tuple[dict[str, Any], tuple[int, int]]


EXACT: list[Transform] = [
    RandomHorizontalFlip(p=0.5),
    RandomVerticalFlip(p=0.5),
    RandomAffine(30, (0.1, 0.1), (0.7, 1.4)),
    RandomRotation((-180, 180)),
    RandomResizedCrop((200, 300), min_visible=None),
    RandomResizedCrop(128, ratio=(0.7, 1.4), min_visible=None),
    CenterCrop((90, 70)),
    Resize((150, 220)),
    Resize(80),
    LetterBox((160, 200)),
    RandomVirtualCamera(8, 8, 20, (0.8, 1.3)),
]


SKEWED = [RandomPerspective(0.3, p=1.0, allow_skew=True), RandomAffine(10, shear=15)]


AFFINE = [
    transform for transform in (*EXACT, SKEWED[1]) if not isinstance(transform, RandomVirtualCamera)
]


def check_from_scratch(
    before: dict[str, Any], after: dict[str, Any], plan: Plan, *, skew: bool = False
) -> None:
    """Everything that follows from the cuboids and the new camera, computed anew, and the pixels
    mapped by H."""
    H, mirrored = after["H_out_in"], after["mirrored"]
    K, image_hw = after["K"], final_hw(plan)
    assert mirrored == (float(torch.linalg.det(H)) < 0)
    assert min(float(K[0, 0]), float(K[1, 1])) > 0
    assert skew or abs(float(K[0, 1])) < 1e-6 * float(K[0, 0])
    corner_order = list(MIRRORED_CORNERS) if mirrored else list(range(8))
    box = Cuboid(after["center"], after["rotation"], after["size"])  # raises unless det R = +1
    scale = 1 + float(after["corners_3d"].abs().amax()) if len(box.center) else 1.0
    assert_close(box.corners(), after["corners_3d"], atol=1e-9 * scale, rtol=0)
    w = (before["corners_2d"] @ H[2, :2] + H[2, 2]) * torch.sign(
        torch.tensor(float(H[2, 2]), dtype=F64)
    )
    usable = (w > 0.05) & before["corner_in_front"]
    aimed = apply_homography(H, before["corners_2d"])[:, corner_order]
    usable = usable[:, corner_order] & (aimed.abs() < 1e5).all(-1)
    px, _ = project(K, after["corners_3d"])
    assert_close(px[usable], aimed[usable], atol=1e-6, rtol=1e-9)
    assert_close(after["corners_2d"], px, atol=1e-9, rtol=1e-12)
    seen = face_visibility(box, K, image_hw)
    face_order = list(MIRRORED_FACES) if mirrored else list(range(6))
    assert (
        after["face_visible"] == before["face_visible"][:, face_order]
    ).all()  # never changes but for the swap
    assert_close(
        after["R"] @ after["R"].mT,
        torch.eye(3, dtype=F64).expand_as(after["R"]),
        atol=1e-10,
        rtol=0,
    )
    assert (torch.linalg.det(after["R"]) > 0).all()
    vertices_cam = after["vertices"] @ after["R"].mT + after["t"][:, None]
    assert_close(vertices_cam[:, corner_order], after["corners_3d"], atol=1e-9 * scale, rtol=0)
    grazing = (face_visibility(box, K, image_hw).visible != after["face_visible"]).any(-1)
    clear = ~grazing
    for name, fresh in (
        ("face_area", seen.area),
        ("face_share", seen.share),
        ("face_share_in_image", seen.share_in_image),
        ("truncation", seen.truncation),
    ):
        assert_close(after[name][clear], fresh[clear], atol=1e-9, rtol=1e-7)
    assert (after["corner_in_front"] == corners_in_front(box)).all()
    keypoints_px, depth = project(K, after["keypoints_3d"] @ after["R"].mT + after["t"][:, None])
    shown = after["keypoints"][..., 2] > 0
    assert_close(keypoints_px[shown], after["keypoints"][..., :2][shown], atol=1e-6, rtol=1e-9)
    assert (depth[shown] > 0).all()


@thorough(1000)
@given(scenes(), st.lists(st.sampled_from(EXACT), min_size=5, max_size=5), st.integers(0, 10**6))
def test_any_chain_of_five_transforms_keeps_the_camera_true(
    given_scene: Scene, chain: list[Transform], index: int
) -> None:
    target, image_hw = given_scene
    after, plan = mapped(Compose(chain), target, image_hw, (0, index))
    check_from_scratch(target, after, plan)


@thorough(1000)
@given(
    scenes(anywhere=True),
    st.lists(st.sampled_from([*EXACT, *SKEWED]), min_size=1, max_size=3),
    st.integers(0, 10**6),
)
def test_boxes_behind_and_around_the_camera_follow_skewed_maps_too(
    given_scene: Scene, chain: list[Transform], index: int
) -> None:
    target, image_hw = given_scene
    after, plan = mapped(Compose(chain, allow_skew=True), target, image_hw, (0, index))
    check_from_scratch(target, after, plan, skew=True)


@thorough(1000)
@given(scenes(), st.sampled_from(AFFINE), st.integers(0, 10**6))
def test_shares_stay_and_areas_scale_under_affine_maps(
    given_scene: Scene, transform: Transform, index: int
) -> None:
    target, image_hw = given_scene
    after, plan = mapped(Compose([transform], allow_skew=True), target, image_hw, (0, index))
    order = list(MIRRORED_FACES) if after["mirrored"] else list(range(6))
    scale = abs(float(np.linalg.det(plan.H_out_in)))
    assert_close(after["face_share"], target["face_share"][:, order], atol=1e-9, rtol=1e-7)
    assert_close(after["surface_share"], target["surface_share"][:, order], atol=0, rtol=0)
    assert_close(after["face_area"], target["face_area"][:, order] * scale, atol=1e-6, rtol=1e-7)


@thorough(1000)
@given(scenes(), st.sampled_from([RandomHorizontalFlip(p=1), RandomVerticalFlip(p=1)]))
def test_two_flips_are_none(given_scene: Scene, flip: Transform) -> None:
    target, image_hw = given_scene
    after, _ = mapped(Compose([flip]), target, image_hw)
    after, _ = mapped(Compose([flip]), after, image_hw)
    assert after["mirrored"] is False
    for name, value in target.items():
        if isinstance(value, Tensor) and name not in ("keypoints", "boxes"):  # those know the frame
            assert_close(after[name], value, atol=1e-9, rtol=1e-9, msg=f"{name} differs")
    assert_close(after["keypoints"][..., :2], target["keypoints"][..., :2], atol=1e-9, rtol=1e-9)


@thorough(1000)
@given(
    scenes(),
    st.lists(st.sampled_from([*EXACT, *SKEWED]), min_size=1, max_size=3),
    st.integers(0, 10**6),
)
def test_a_map_and_its_inverse_are_none(
    given_scene: Scene, chain: list[Transform], index: int
) -> None:
    target, image_hw = given_scene
    compose = Compose(chain, allow_skew=True)
    after, plan = mapped(compose, target, image_hw, (0, index))
    back = map_fields(
        read_target(after, final_hw(plan)),
        np.linalg.inv(after["H_out_in"].numpy()),
        image_hw,
        allow_skew=True,
    )
    for name in (
        "K",
        "R",
        "t",
        "corners_3d",
        "center",
        "rotation",
        "vertices",
        "keypoints_3d",
        "face_visible",
    ):
        assert_close(
            torch.from_numpy(back.values[name]),
            target[name],
            atol=1e-7,
            rtol=1e-7,
            msg=f"{name} differs",
        )
    assert back.others["mirrored"] is False


def test_depth_changes_by_the_law() -> None:
    target = scene()
    _, plan = mapped(
        Compose([RandomVirtualCamera((9, 9), (-6, -6), (30, 30), (1.2, 1.2))]), target, (120, 160)
    )
    H = torch.from_numpy(plan.H_out_in)
    update = update_camera(H, target["K"])
    corners = target["corners_3d"]
    px, depth = project(target["K"], corners)
    w = px @ H[2, :2] + H[2, 2]
    assert_close((corners @ update.Q.mT)[..., 2], w * depth / update.k, atol=1e-12, rtol=0)


def test_a_plain_turn_of_a_camera_with_unequal_focal_lengths_is_refused_for_its_skew() -> None:
    target = scene(1)
    angle = math.radians(20)
    H = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )
    with pytest.raises(SampleError, match=r"scene: K: .*skew .* RandomRotation"):
        map_fields(read_target(target, (120, 160)), H, (120, 160))
    assert (
        abs(
            float(
                map_fields(read_target(target, (120, 160)), H, (120, 160), allow_skew=True).values[
                    "K"
                ][0, 1]
            )
        )
        > 1
    )


@pytest.mark.parametrize(
    ("transform", "image_hw", "expected"),
    [
        (Resize((60, 80)), (60, 80), [[100, 0, 39.75], [0, 50, 24.75], [0, 0, 1]]),
        (Resize(60), (60, 80), [[100, 0, 39.75], [0, 50, 24.75], [0, 0, 1]]),
        (CenterCrop((100, 100)), (100, 100), [[200, 0, 50], [0, 100, 40], [0, 0, 1]]),
        (PadTo((130, 200)), (130, 200), [[200, 0, 100], [0, 100, 55], [0, 0, 1]]),
        (PadTo((130, 200), "top_left"), (130, 200), [[200, 0, 80], [0, 100, 50], [0, 0, 1]]),
        (LetterBox((120, 80)), (120, 80), [[100, 0, 39.75], [0, 50, 54.75], [0, 0, 1]]),
        (
            LetterBox((240, 240), enlarge=False),
            (240, 240),
            [[200, 0, 120], [0, 100, 110], [0, 0, 1]],
        ),
        (RandomHorizontalFlip(p=1), (120, 160), [[200, 0, 79], [0, 100, 50], [0, 0, 1]]),
        (RandomVerticalFlip(p=1), (120, 160), [[200, 0, 80], [0, 100, 69], [0, 0, 1]]),
    ],
)
def test_intrinsics_change_as_a_person_computes(
    transform: Transform, image_hw: tuple[int, int], expected: list[list[float]]
) -> None:
    K = torch.tensor([[200.0, 0, 80], [0, 100, 50], [0, 0, 1]], dtype=F64)
    after, plan = mapped(Compose([transform]), {"K": K}, (120, 160))
    assert_close(after["K"], torch.tensor(expected, dtype=F64))
    assert final_hw(plan) == image_hw


def test_an_empty_picture_and_thirty_boxes_go_through_alike() -> None:
    chain = Compose(
        [
            RandomHorizontalFlip(1),
            RandomAffine(10, scale=(0.9, 1.1)),
            RandomResizedCrop(64),
            RandomVirtualCamera(2, 2, 2),
        ]
    )
    for count in (0, 30):
        target = scene(count)
        after, plan = mapped(chain, target, (120, 160))
        assert set(target) <= {*after, "surface_share"}  # which only affine maps keep
        assert after["corners_3d"].shape == (count if plan.keep is None else len(plan.keep), 8, 3)


def test_names_form_a_group_of_two() -> None:
    plain, mirror = Relabelling(torch.tensor(False)), Relabelling(torch.tensor(True))
    assert not (mirror @ mirror).mirrored
    assert (plain @ mirror).mirrored
    both = Relabelling(torch.tensor([False, True]))
    faces = torch.arange(12.0).reshape(2, 6)
    assert both.faces(faces).tolist() == [[0, 1, 2, 3, 4, 5], [6, 7, 9, 8, 10, 11]]
    corners = torch.arange(48.0).reshape(2, 8, 3)
    assert both.corners(corners)[1, :, 0].tolist() == corners[1, list(MIRRORED_CORNERS), 0].tolist()
    keypoints = torch.arange(30.0).reshape(2, 5, 3)
    assert both.keypoints(keypoints, KEYPOINT_MIRROR)[:, :, 0].tolist() == [
        [0, 3, 6, 9, 12],
        [18, 15, 21, 27, 24],
    ]


def test_the_law_is_differentiable_in_the_camera_and_batched() -> None:
    K = scene(1)["K"].expand(2, 3, 3).clone().requires_grad_()
    H = (
        torch.tensor([[1.1, 0.1, 3], [0, 0.9, -2], [1e-4, 0, 1]], dtype=F64)
        .expand(2, 3, 3)
        .clone()
        .requires_grad_()
    )
    R, t = torch.eye(3, dtype=F64).expand(2, 3, 3), torch.ones(2, 3, dtype=F64)
    assert torch.autograd.gradcheck(
        lambda K, H: tuple(
            x for x in (update_camera(H, K, R, t).K, update_camera(H, K, R, t).R) if x is not None
        ),
        (K, H),
    )
