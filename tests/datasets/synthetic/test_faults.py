"""Annotations of synthetic animals, and what the dial of faults does to them.

Numbers to check by hand.
"""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.datasets.synthetic.annotation import (
    Annotation,
    annotate,
    camera_parameters,
    root_joint,
)
from animal3dbox.datasets.synthetic.faults import FaultConfig, faulty, resized_mask, swap_order
from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal, synthetic_animal, synthetic_scene
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.camera import project
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26, VOCABULARIES
from animal3dbox.smal.parameters import posed_body
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

F64 = torch.float64
SMALL = (96, 128)


@pytest.fixture(scope="module")
def animal() -> SyntheticAnimal:
    return synthetic_scene(
        5, 3, WorldConfig(image_hw=SMALL, focal_px=(100.0, 900.0), truncated=1.0)
    ).animals[0]


def many(count: int = 4000) -> Annotation:
    """A clean annotation with so many keypoints at (50, 60), a quarter of them hidden, in an image
    of 100 x 200."""
    keypoints = torch.tensor([[50.0, 60.0, 1.0]], dtype=F64).repeat(count, 1)
    keypoints[: count // 4, 2] = 0
    base = annotate(synthetic_animal(0, 0, SMALL))
    return replace(base, keypoints_2d=keypoints, image_hw=(100, 200), sample_id="many")


# The true annotation
# --------------------------------------------------------------------------------------------------


def test_the_parameters_pose_the_body_in_the_camera_frame(animal: SyntheticAnimal) -> None:
    body = posed_body(animal.model, camera_parameters(animal))
    assert_close(body.vertices[0], animal.vertices_cam, rtol=0, atol=1e-12)
    assert_close(body.R_world_joint[0], animal.R @ animal.R_world_joint, rtol=0, atol=1e-12)


def test_hidden_keypoints_are_marked_only_if_asked(animal: SyntheticAnimal) -> None:
    seen, marked = annotate(animal), annotate(animal, hidden="marked")
    assert torch.equal(seen.keypoints_2d[:, 2] > 0, animal.keypoint_visible)
    assert torch.equal(marked.keypoints_2d, animal.keypoints_2d)
    assert torch.equal(seen.keypoints_2d[:, :2], marked.keypoints_2d[:, :2])
    assert 0 < int(animal.keypoint_visible.sum()) < int((animal.keypoints_2d[:, 2] > 0).sum()) < 26


# Keypoints
# --------------------------------------------------------------------------------------------------


def test_at_rest_nothing_changes(animal: SyntheticAnimal) -> None:
    clean, after = annotate(animal), faulty(annotate(animal), FaultConfig(), 7)
    assert FaultConfig().at_rest
    assert not FaultConfig(noise_px=1).at_rest
    assert torch.equal(after.keypoints_2d, clean.keypoints_2d)
    assert torch.equal(after.mask, clean.mask)
    assert torch.equal(after.K, clean.K)
    assert_close(after.parameters.trans, clean.parameters.trans, rtol=0, atol=1e-14)
    assert torch.equal(after.parameters.pose, clean.parameters.pose)


def test_noise_has_its_size_grows_with_its_dial_and_leaves_what_is_outside_the_frame() -> None:
    clean = many()
    clean.keypoints_2d[-10:] = 0
    one, three = (faulty(clean, FaultConfig(noise_px=sigma)).keypoints_2d for sigma in (1.0, 3.0))
    step = one[:-10, :2] - clean.keypoints_2d[:-10, :2]
    assert abs(float(step.std()) - 1) < 0.05
    assert_close(three[:-10, :2] - clean.keypoints_2d[:-10, :2], 3 * step)
    assert torch.equal(one[-10:], clean.keypoints_2d[-10:])
    assert torch.equal(one[:, 2], clean.keypoints_2d[:, 2])


def test_outliers_missing_zeros_and_flags_come_in_their_parts() -> None:
    clean, visible = many(), slice(1000, None)
    wild = faulty(clean, FaultConfig(outliers=0.3)).keypoints_2d
    moved = (wild[visible, :2] != clean.keypoints_2d[visible, :2]).any(1)
    assert abs(float(moved.double().mean()) - 0.3) < 0.03
    assert torch.equal(wild[:1000], clean.keypoints_2d[:1000])
    assert bool(((wild[:, :2] >= -0.5) & (wild[:, :2] <= torch.tensor([199.5, 99.5]))).all())
    assert float(wild[visible, 0].amax()) > 190
    missing = faulty(clean, FaultConfig(missing=0.2)).keypoints_2d
    assert abs(float(missing[visible, 2].mean()) - 0.8) < 0.03
    zeros = faulty(clean, FaultConfig(zeros=0.1)).keypoints_2d
    at_zero = (zeros[:, :2] == 0).all(1)
    assert abs(float(at_zero[visible].double().mean()) - 0.1) < 0.02
    assert bool((zeros[at_zero, 2] == 1).all())
    flags = faulty(clean, FaultConfig(wrong_flags=0.25)).keypoints_2d
    assert abs(float((flags[:, 2] != clean.keypoints_2d[:, 2]).double().mean()) - 0.25) < 0.03
    assert int((flags[:1000, 2] == 1).sum()) > 150


def test_one_dial_does_not_change_the_draws_of_another_and_seeds_and_samples_do() -> None:
    clean = many()
    alone, both = (
        faulty(clean, FaultConfig(missing=0.2)),
        faulty(clean, FaultConfig(missing=0.2, noise_px=2)),
    )
    assert torch.equal(alone.keypoints_2d[:, 2], both.keypoints_2d[:, 2])
    assert torch.equal(
        faulty(clean, FaultConfig(noise_px=2)).keypoints_2d[:, :2], both.keypoints_2d[:, :2]
    )
    assert not torch.equal(
        faulty(clean, FaultConfig(missing=0.2), 1).keypoints_2d, alone.keypoints_2d
    )
    assert not torch.equal(
        faulty(replace(clean, sample_id="another"), FaultConfig(missing=0.2)).keypoints_2d,
        alone.keypoints_2d,
    )


@pytest.mark.parametrize(
    ("part", "swapped", "kept"),
    [
        (
            "all",
            {"left_eye", "left_front_paw", "left_shoulder", "right_back_hock"},
            {"nose", "tail_base", "neck", "chin"},
        ),
        (
            "legs",
            {
                "left_front_paw",
                "left_front_elbow",
                "left_front_wrist",
                "left_back_paw",
                "left_back_knee",
            },
            {"left_eye", "left_shoulder"},
        ),
        (
            "fore",
            {"left_front_paw", "left_front_elbow"},
            {"left_back_paw", "left_shoulder", "left_ear"},
        ),
        (
            "hind",
            {"left_back_paw", "left_back_knee", "left_back_hock"},
            {"left_front_paw", "left_ear"},
        ),
        ("head", {"left_eye", "left_ear", "left_mouth"}, {"left_front_paw", "nose"}),
        ("none", set(), set(ANIMAL3D_26)),
    ],
)
def test_swaps_exchange_left_and_right_of_their_part(
    part: str, swapped: set[str], kept: set[str]
) -> None:
    order = swap_order(VOCABULARIES["animal3d26"], part)  # type: ignore[arg-type]
    twin = {"left": "right", "right": "left"}
    for name in swapped:
        side, _, rest = name.partition("_")
        assert ANIMAL3D_26[order[ANIMAL3D_26.index(name)]] == f"{twin[side]}_{rest}"
    for name in kept:
        assert ANIMAL3D_26[order[ANIMAL3D_26.index(name)]] == name
    assert [order[i] for i in order] == list(range(26))


def test_swapped_animals_are_a_part_of_all_and_their_points_change_places(
    animal: SyntheticAnimal,
) -> None:
    clean = annotate(animal)
    after = faulty(clean, FaultConfig(swap="all"))
    left, right = ANIMAL3D_26.index("left_eye"), ANIMAL3D_26.index("right_eye")
    assert torch.equal(after.keypoints_2d[left], clean.keypoints_2d[right])
    config = FaultConfig(swap="all", swapped=0.5)
    changed = [
        not torch.equal(faulty(clean, config, seed).keypoints_2d, clean.keypoints_2d)
        for seed in range(100)
    ]
    assert 35 <= sum(changed) <= 65


# Camera, body, mask
# --------------------------------------------------------------------------------------------------


def test_a_wrong_focal_length_moves_the_body_in_depth_so_that_it_looks_the_same(
    animal: SyntheticAnimal,
) -> None:
    clean = annotate(animal)
    half = faulty(clean, FaultConfig(focal_factor=0.5))
    assert_close(half.K[:2, :2], clean.K[:2, :2] / 2)
    assert torch.equal(half.K[:2, 2], clean.K[:2, 2])
    root = root_joint(animal.model, clean.parameters.betas)
    before, after = (project(a.K, (root + a.parameters.trans)[None])[0] for a in (clean, half))
    assert_close(before, after)
    assert_close((root + half.parameters.trans)[2], (root + clean.parameters.trans)[2] / 2)


def test_a_misfit_turns_the_joints_but_not_the_root_and_scales_the_body_about_it(
    animal: SyntheticAnimal,
) -> None:
    clean = annotate(animal)
    turned = faulty(clean, FaultConfig(joint_deg=4.0)).parameters.pose - clean.parameters.pose
    assert not turned[0].any()
    assert abs(math.degrees(float(turned[1:].std())) - 4.0) < 0.8
    larger = posed_body(animal.model, faulty(clean, FaultConfig(body_scale=1.2)).parameters)
    true = posed_body(animal.model, clean.parameters)
    assert_close(larger.joints[0, 0], true.joints[0, 0], rtol=0, atol=1e-12)
    length = [
        float((body.joints[0] - body.joints[0, 0]).norm(dim=1).sum()) for body in (true, larger)
    ]
    assert length[1] / length[0] == pytest.approx(1.2, abs=1e-9)


def test_masks_grow_and_shrink_by_whole_pixels_and_never_vanish() -> None:
    mask = torch.zeros(20, 30, dtype=torch.bool)
    mask[5:12, 10:21] = True  # 7 rows, 11 columns

    def extent(m: Tensor) -> tuple[int, int]:
        return int(m.any(1).sum()), int(m.any(0).sum())

    assert extent(resized_mask(mask, 2)) == (11, 15)
    assert extent(resized_mask(mask, -2)) == (3, 7)
    assert resized_mask(mask, 0) is mask
    assert torch.equal(resized_mask(mask, -6), mask)
    full = torch.ones(8, 8, dtype=torch.bool)
    assert torch.equal(resized_mask(full, -2), full)  # the frame is no outline


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("outliers", 1.5),
        ("noise_px", -1.0),
        ("focal_factor", 0.0),
        ("swap", "tail"),
        ("body_scale", 0.0),
    ],
)
def test_impossible_faults_are_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"^{field} must"):
        FaultConfig(**{field: value})  # type: ignore[arg-type]


def test_the_quadrupeds_size_column_is_what_scaling_relies_on() -> None:
    model = load_quadruped()
    assert_close(model.shapedirs[:, :, 0], 0.1 * model.v_template, rtol=0, atol=1e-6)
