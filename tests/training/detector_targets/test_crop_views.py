"""Views of stored crops obey the camera law, and directions of noses mean what they say."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from animal3dbox.datasets import SyntheticDataset
from animal3dbox.errors import ConfigError, ShapeError
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.training.detector_targets import (
    BoxCoder,
    CropViews,
    DirectionBins,
    StoredCrops,
    rotation_to_6d,
)

MIRRORED = torch.tensor([1.0, -1, 1])
"""Of points in the box's own axes, what a mirror does: left and right change places."""


def dotted_crops(count: int, points_box: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    """Crops (N, 3, 96, 96) of boxes one of whose points (3,) is a bright dot, and their truth."""
    rng = torch.Generator().manual_seed(0)
    turns = 3 * torch.rand(count, 3, generator=rng, dtype=torch.float64)
    rotation = rotation_from_axis_angle(turns)
    K = torch.tensor([[600.0, 0, 20], [0, 640, 80], [0, 0, 1]], dtype=torch.float64)
    K = K.repeat(count, 1, 1)
    ray = torch.linalg.solve(K[0], torch.tensor([47.5, 47.5, 1], dtype=torch.float64))
    center = (ray * 9).expand(count, 3)
    dots, _ = project(K, (rotation @ points_box.double() + center)[:, None])
    y, x = torch.meshgrid(*[torch.arange(96, dtype=torch.float64)] * 2, indexing="ij")
    far = (x - dots[:, 0, 0, None, None]) ** 2 + (y - dots[:, 0, 1, None, None]) ** 2
    pixels = (255 * torch.exp(-far / 8)).round().to(torch.uint8)[:, None].expand(-1, 3, -1, -1)
    return pixels, {"K": K, "rotation": rotation, "center": center, "size": torch.ones(count, 3)}


def middle_of_light(pixels: Tensor) -> Tensor:
    """The px (N, 2) about which the light of pictures (N, 3, s, s) lies."""
    light = (pixels[:, 0] - pixels[:, 0].amin((1, 2), keepdim=True)).double()
    light = light / light.sum((1, 2), keepdim=True)
    steps = torch.arange(pixels.shape[-1], dtype=torch.float64)
    return torch.stack(((light * steps).sum((1, 2)), (light * steps[:, None]).sum((1, 2))), 1)


@pytest.mark.parametrize("drawn", [False, True], ids=["plain", "drawn"])
def test_a_point_of_the_box_is_seen_where_the_view_s_camera_says(drawn: bool) -> None:
    point = torch.tensor([0.2, 0.12, -0.1])
    crops, truth = dotted_crops(40, point)
    views = CropViews(turn_deg=(15, 15, 40), zoom=0.2)
    rng = torch.Generator().manual_seed(1)
    pixels, seen = views.drawn(crops, truth, rng) if drawn else views.plain(crops, truth)
    assert pixels.shape == (40, 3, 64, 64)
    # the law keeps rotations proper: of a mirrored view the box's own y is mirrored with the scene
    by_side = [
        project(seen["K"], (seen["rotation"] @ (point.double() * s) + seen["center"])[:, None])[0]
        for s in (torch.ones(3), MIRRORED)
    ]
    off = torch.stack([(px[:, 0] - middle_of_light(pixels)).norm(dim=1) for px in by_side])
    assert float(off.amin(0).max()) < 0.15
    mirrored = off.argmin(0).sum()
    assert (8 < int(mirrored) < 32) if drawn else int(mirrored) == 0
    assert float((torch.linalg.det(seen["rotation"]) - 1).abs().max()) < 1e-9
    assert seen["size"] is truth["size"]


def test_a_view_without_any_change_is_the_plain_one() -> None:
    crops, truth = dotted_crops(3, torch.tensor([0.2, 0.1, 0.0]))
    still = CropViews(mirror=False, zoom=0, shift=0, turn_deg=(0, 0, 0), colour=0)
    (pixels, seen), (same, plain) = (
        still.drawn(crops, truth, torch.Generator()),
        still.plain(crops, truth),
    )
    assert torch.allclose(pixels, same, atol=1e-4)
    for name in ("K", "center", "rotation", "boxes"):
        assert torch.allclose(seen[name], plain[name], atol=1e-9), name


def test_options_and_crops_that_cannot_be_are_refused() -> None:
    for options in ({"side": 0}, {"zoom": -1.0}, {"turn_deg": (0.0, 50.0, 0.0)}, {"colour": 1.0}):
        with pytest.raises(ConfigError):
            CropViews(**options)
    for shape in ((1, 3, 96, 90), (1, 3, 60, 60)):
        with pytest.raises(ShapeError, match="crops"):
            CropViews().plain(torch.zeros(shape, dtype=torch.uint8), {})


def test_directions_are_even_and_their_likelihoods_are_about_the_nose() -> None:
    bins = DirectionBins(count=64)
    vectors = bins.vectors
    assert torch.allclose(vectors.norm(dim=1), torch.ones(64), atol=1e-6)
    apart = torch.rad2deg(torch.acos((vectors @ vectors.T - 2 * torch.eye(64)).amax(1)))
    assert 18 < float(apart.min()) < float(apart.max()) < 30
    rotations = rotation_from_axis_angle(3 * torch.rand(200, 3, generator=torch.Generator()))
    likely, nearest = (rule(rotation_to_6d(rotations)) for rule in (bins.likelihoods, bins.nearest))
    assert torch.allclose(likely.sum(1), torch.ones(200), atol=1e-5)
    assert torch.equal(likely.argmax(1), nearest)
    assert float((vectors[nearest] * rotations[:, :, 0]).sum(1).min()) > 0.9  # within 25 degrees


def test_a_mirrored_picture_s_likelihoods_come_back_to_the_animal_s_own() -> None:
    bins, forward = DirectionBins(count=256, sharpness=50.0), torch.tensor([[0.6, 0.48, 0.64]])
    own = bins.likelihoods(forward)
    mirrored = bins.likelihoods(forward * torch.tensor([-1.0, 1, 1]))
    back = bins.vectors[bins.unmirrored(mirrored).argmax(1)]
    assert float((back * forward).sum()) > 0.98
    assert float((bins.vectors[mirrored.argmax(1)] * forward).sum()) < 0.5
    assert float((bins.unmirrored(mirrored) - own).abs().sum()) < 0.7


@pytest.mark.parametrize("options", [{"count": 0}, {"sharpness": 0.0}])
def test_bins_that_cannot_be_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ConfigError):
        DirectionBins(**options)  # type: ignore[arg-type]


def sample(animals: int, place: float) -> tuple[Tensor, dict[str, Tensor]]:
    """A picture of some animals, the k-th of which is all as bright as k."""
    boxes = torch.tensor([[8.0 + place, 8, 28, 20]]).repeat(animals, 1)
    boxes[:, 2] += torch.arange(animals)
    target = {
        "boxes": boxes,
        "K": torch.tensor([[50.0, 0, 19.5], [0, 50, 19.5], [0, 0, 1]]),
        "center": torch.tensor([[0.0, 0, 5]]).repeat(animals, 1),
        "rotation": torch.eye(3).repeat(animals, 1, 1),
        "size": torch.ones(animals, 3),
    }
    return torch.full((3, 40, 40), 7, dtype=torch.uint8), target


def test_stored_crops_go_back_to_their_images_and_skipped_samples_have_none() -> None:
    crops = StoredCrops.of([sample(2, 0), "skipped", sample(0, 0), sample(1, 3)], side=48)
    assert (len(crops), crops.image.tolist()) == (3, [0, 0, 3])
    assert crops.weight.tolist() == [1, 1, 1]
    predicted = {"scores": torch.tensor([0.1, 0.2, 0.3])}
    predictions, targets = crops.by_image(predicted)
    assert [one["scores"].tolist() for one in predictions] == [
        pytest.approx([0.1, 0.2]),
        pytest.approx([0.3]),
    ]
    assert [len(one["boxes"]) for one in targets] == [2, 1]
    assert predictions[1]["boxes"].tolist() == [[11.0, 8, 28, 20]]
    assert crops.at(torch.tensor([2])).boxes.tolist() == [[11.0, 8, 28, 20]]
    with pytest.raises(ShapeError, match="scores must have 3 rows"):
        crops.by_image({"scores": torch.ones(2)})
    with pytest.raises(ConfigError, match="no animal"):
        StoredCrops.of(["skipped"])


def test_kept_crops_are_those_of_the_dataset_that_asks_for_them(tmp_path: Path) -> None:
    world, path = SyntheticDataset(4, seed=5, image_hw=(96, 128)), tmp_path / "crops"
    first = StoredCrops.kept(world, path)
    again = StoredCrops.kept(world, path)
    assert torch.equal(first.pixels, again.pixels)
    assert first.digest == again.digest != first.at(torch.arange(2)).digest
    others = {
        "image names": SyntheticDataset(4, seed=6, image_hw=(96, 128)),
        "length": SyntheticDataset(3, seed=5, image_hw=(96, 128)),
        "of image 0 differ": SyntheticDataset(4, seed=5, image_hw=(120, 160)),
    }
    for problem, other in others.items():
        with pytest.raises(ConfigError, match=f"{problem}.*give another path, or delete it"):
            StoredCrops.kept(other, path)
    with pytest.raises(ConfigError, match="pixels of image 0 differ"):
        StoredCrops.kept(world, path, side=48)
    with pytest.raises(ConfigError, match="of image 0 differ"):
        StoredCrops.kept(world, path, margin=0.3)
    two = [sample(1, 0), sample(2, 3)]
    StoredCrops.kept(two, tmp_path / "list")
    with pytest.raises(ConfigError, match="image 0 has no animal"):
        StoredCrops.kept(["skipped", sample(2, 3)], tmp_path / "list")
    torch.save({name: getattr(first, name) for name in vars(first)}, path)
    with pytest.raises(ConfigError, match="of an older version"):
        StoredCrops.kept(world, path)


def test_what_is_decoded_from_views_is_in_the_frame_of_the_image() -> None:
    crops = StoredCrops.of([sample(2, 0), sample(1, 3)])
    coder = BoxCoder(virtual_focal_px=1000.0)
    _, seen = CropViews().plain(crops.pixels, crops.truth)
    boxes = coder.decode(coder.encode(seen), boxes=seen["boxes"], K=seen["K"])
    for name in ("center", "rotation", "size"):
        assert torch.allclose(boxes[name], getattr(crops, name), atol=1e-4), name
