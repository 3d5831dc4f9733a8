"""Fields of a target: the forms in which they come and leave, and those that are refused."""

import pickle
from typing import Any

import numpy as np
import pytest
import torch
from pictures import HW, picture, same
from scenes import F64, KEYPOINT_MIRROR, scene
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import SampleError
from animal3dbox.transforms import (
    CenterCrop,
    Compose,
    RandomAffine,
    RandomErasing,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomRotation,
    RandomVirtualCamera,
    Resize,
    Transform,
)


def test_targets_leave_in_the_form_in_which_they_came_and_the_old_one_is_untouched() -> None:
    target = {
        name: value.numpy() if isinstance(value, Tensor) else value
        for name, value in scene(2, dtype=torch.float32).items()
    }
    kept = {name: np.copy(value) for name, value in target.items() if isinstance(value, np.ndarray)}
    _, after = Compose([RandomHorizontalFlip(1), Resize(50)])(picture(), target)
    for name, value in kept.items():
        assert (target[name] == value).all()
        assert isinstance(after[name], np.ndarray)
        assert after[name].dtype == value.dtype
    assert isinstance(after["H_out_in"], np.ndarray)
    assert after["H_out_in"].dtype == np.float32
    assert after["image_id"] == "scene"


def test_bare_cuboids_and_bare_images_are_enough() -> None:
    full = scene()
    compose = Compose(
        [
            RandomHorizontalFlip(1),
            RandomAffine(9),
            RandomVirtualCamera(2, 2, 2),
            RandomResizedCrop(64),
        ]
    )
    for names in (("K", "corners_3d"), ("K", "center", "rotation", "size"), ("K",)):
        _, after = compose(picture(), {name: full[name] for name in names})
        assert set(after) == {*names, "H_out_in", "mirrored"}
    image, after = Compose([RandomHorizontalFlip(1), RandomAffine(9)])(
        picture(), {"corners_2d": full["corners_2d"], "labels": torch.arange(2)}
    )
    assert set(after) == {"corners_2d", "labels", "H_out_in", "mirrored"}
    assert image.shape == (3, *HW)


@pytest.mark.parametrize(
    ("change", "field", "says"),
    [
        ({"K": torch.eye(4, dtype=F64)}, "K", r"shape \(3, 3\)"),
        ({"K": torch.eye(3, dtype=F64)[None]}, "K", r"shape \(3, 3\)"),
        ({"K": torch.diag(torch.tensor([-1.0, 1, 1], dtype=F64))}, "K", "positive focal"),
        ({"K": torch.full((3, 3), float("nan"))}, "K", "NaN"),
        ({"K": torch.eye(3, dtype=torch.int64)}, "K", "floating point"),
        ({"K": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "K", "tensor or an array"),
        ({"H_out_in": torch.zeros(2, 3, dtype=F64)}, "H_out_in", "shape"),
        ({"corners_3d": torch.zeros(2, 7, 3, dtype=F64)}, "corners_3d", "shape"),
        ({"R": torch.zeros(2, 4, 4, dtype=F64)}, "R", "shape"),
        ({"t": torch.zeros(3, 3, dtype=F64)}, "", "disagree on the number of animals"),
        ({"labels": torch.zeros(5)}, "", "disagree on the number of animals|floating"),
        ({"meta": {"quality": [{}]}}, "meta: quality", "1 records for 2 animals"),
        ({"meta": {"sample_ids": "scene#0"}}, "meta: sample_ids", "one record an animal, got str"),
        ({"meta": {"scale_source": ()}}, "meta: scale_source", "0 records for 2 animals"),
        ({"meta": [1, 2]}, "meta", "must be a dict"),
        ({"masks": torch.zeros(2, 60, 80, dtype=torch.uint8)}, "masks", "stale"),
        ({"depth": torch.zeros(60, 80)}, "depth", "stale"),
        ({"distortion": torch.zeros(3, dtype=F64)}, "distortion", "OpenCV's order"),
        ({"intrinsics": torch.eye(3)}, "intrinsics", "could hold a camera"),
        ({"P2": np.zeros((3, 4))}, "P2", "could hold a camera"),
        ({"calib": {"P2": np.zeros((3, 4))}}, "calib", "could hold a camera"),
        ({"cam2img": [torch.eye(3)]}, "cam2img", "could hold a camera"),
        ({"area": torch.ones(2)}, "area", "unknown field"),
        ({"P2": [[1.0, 0, 0, 0]]}, "P2", "could hold a camera"),
        (
            {"annotations": [{"bbox": [1.0, 2.0, 3.0, 4.0]}, {}]},
            "annotations",
            "could hold a camera",
        ),
        ({"intrinsics": {"fx": 500.0}}, "intrinsics", "could hold a camera"),
        ({"camera": object()}, "camera", "could hold a camera"),
        ({"masks": torch.zeros(2, *HW, dtype=torch.float16)}, "masks", "convert it to uint8"),
        ({"keypoint_mirror": torch.tensor([0, 1, 2])}, "keypoint_mirror", "permutation of 0 to 4"),
        (
            {"keypoint_mirror": torch.tensor([1, 2, 0, 3, 4])},
            "keypoint_mirror",
            "swap keypoints in pairs",
        ),
        ({"corners_2d": torch.zeros(2, 8, 2, dtype=F64)}, "K", "stale"),
        ({"size": torch.ones(2, 3, dtype=F64) * 9}, "corners_3d", "corner order"),
    ],
)
def test_bad_targets_name_the_sample_the_field_and_the_remedy(
    change: dict[str, Any], field: str, says: str
) -> None:
    with pytest.raises(SampleError, match=says) as caught:
        Compose([RandomHorizontalFlip(1)])(picture(), {**scene(), **change})
    assert caught.value.sample_id == "scene"
    assert str(caught.value).startswith(f"scene: {field}")


def test_cuboids_without_intrinsics_and_mirrored_keypoints_without_names_are_refused() -> None:
    target = scene()
    with pytest.raises(SampleError, match=r"scene: corners_3d: .*intrinsics K"):
        Compose([Resize(50)])(
            picture(), {name: value for name, value in target.items() if name != "K"}
        )
    bare = {name: value for name, value in target.items() if name != "keypoint_mirror"}
    with pytest.raises(SampleError, match=r"scene: keypoints: .*keypoint_mirror"):
        Compose([RandomHorizontalFlip(1)])(picture(), bare)
    _, after = Compose([RandomHorizontalFlip(1)], keypoint_mirror=KEYPOINT_MIRROR.tolist())(
        picture(), bare
    )
    assert_close(after["keypoints"][:, 0, 0], 159 - target["keypoints"][:, 1, 0])


def test_what_is_added_to_a_target_is_a_float_whatever_comes_first() -> None:
    _, after = Compose([RandomRotation((10, 10))])(
        picture(), {"labels": torch.tensor([1]), "boxes": torch.ones(1, 4)}
    )
    assert after["H_out_in"].dtype == torch.float32
    masks = np.ones((1, *HW), dtype=np.uint8)
    _, after = Compose([RandomErasing(1, scale=(0.3, 0.3))])(picture(), {"masks": masks})
    assert after["occlusion"].dtype == np.float32
    assert 0 < after["occlusion"][0] < 1


def test_the_user_says_which_fields_of_his_own_follow_dropped_animals() -> None:
    target = {
        **scene(6, seed=1),
        "herd": list("abcdef"),
        "orig_size": torch.tensor([1, 2, 3, 4, 5, 6]),
        "site": "north",
        "scores": torch.rand(6),
    }
    crop = [CenterCrop(40, min_visible=0.9)]
    with pytest.raises(SampleError, match=r"scene: herd: has 6 entries.*per_animal=\['herd'\]"):
        Compose(crop)(picture(), target)
    _, after = Compose(crop, per_animal=["herd"], per_image=["orig_size"])(picture(), target)
    kept = after["labels"].tolist()
    assert after["herd"] == [list("abcdef")[index] for index in kept]
    assert torch.equal(after["scores"], target["scores"][kept])
    assert after["orig_size"].tolist() == [1, 2, 3, 4, 5, 6]
    assert after["site"] == "north"
    with pytest.raises(SampleError, match="herd: holds 2 records for 6 animals"):
        Compose(crop, per_animal=["herd"])(picture(), {**target, "herd": ["a", "b"]})


def test_book_keeping_is_passed_on_and_follows_dropped_animals() -> None:
    meta = {
        "sample_key": (0, 3),
        "sample_ids": [f"herd.jpg#{n}" for n in range(6)],
        "quality": [{"sd": 0.5 * n} for n in range(6)],
        "scale_source": ("species",) * 6,
        "K_source": "exif",
        "lens": {"coefficients": [0.25, 0.5]},
    }
    target = {**scene(6, seed=1), "meta": meta}
    before = pickle.loads(pickle.dumps(target))
    compose = Compose([CenterCrop(40, min_visible=0.9)])
    _, after = compose(picture(), target)
    rows = after["labels"].tolist()
    assert 0 < len(rows) < 6
    assert after["meta"] == {
        **meta,
        "sample_ids": [f"herd.jpg#{n}" for n in rows],
        "quality": [{"sd": 0.5 * n} for n in rows],
        "scale_source": ("species",) * len(rows),
    }
    assert target["meta"] is meta
    assert same({"meta": meta}, {"meta": before["meta"]})
    _, unmoved = Compose([])(picture(), target)
    assert unmoved["meta"] == meta
    assert unmoved["meta"] is not meta


@pytest.mark.parametrize(
    "pipeline",
    [[], [RandomHorizontalFlip(0)], [CenterCrop(HW)], [Resize(HW)], [RandomRotation((5, 5))]],
)
@pytest.mark.parametrize("array", [True, False])
def test_writing_to_what_came_out_changes_nothing_of_what_came_in(
    pipeline: list[Transform], array: bool
) -> None:
    target: dict[str, Any] = {**scene(2), "masks": torch.ones(2, *HW, dtype=torch.uint8)}
    image: Any = picture().permute(1, 2, 0).contiguous().numpy() if array else picture()
    if array:
        target = {
            name: value.numpy() if isinstance(value, Tensor) else value
            for name, value in target.items()
        }
    kept, image_kept = pickle.loads(pickle.dumps(target)), pickle.loads(pickle.dumps(image))
    made, after = Compose(pipeline)(image, target)
    made[:] = 0
    for value in after.values():
        if isinstance(value, Tensor | np.ndarray):
            value[...] = 0
    assert (np.asarray(image) == np.asarray(image_kept)).all()
    for name, value in kept.items():
        assert np.array_equal(np.asarray(target[name]), np.asarray(value)), name
