"""How far from the pixels the boxes land when the camera is updated by one rule or another.

Flip, crop, resize, rotation.

    python benchmarks/camera_rules.py

The picture shows one white blob at a projected corner. OpenCV, NumPy or kornia move the pixels; a
rule moves K (and the scene, for a flip). The blob is found again in the moved picture (its centre
of brightness) and compared with the projection by the rule: the worst corner and coordinate, in
pixels, in the pixel contract of design.md (pixel centres at whole numbers, as OpenCV calibrates). A
camera calibrated with pixel corners at whole numbers would need the rules marked "corner" instead;
the two must not be mixed.
"""

from collections.abc import Callable
from importlib.metadata import version

import cv2
import kornia.augmentation as K  # noqa: N812
import numpy as np
import torch

from animal3dbox.transforms import (
    Compose,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomRotation,
    Resize,
)

HW = (240, 320)
CORNERS = np.array(
    [[x, y, z] for x in (-0.5, 0.5) for y in (-0.4, 0.4) for z in (2.6, 3.4)]
) + np.array([0.1, -0.05, 0])
MIRROR = np.array([-1.0, 1, 1])


def intrinsics(off_center: bool) -> np.ndarray:
    """Intrinsics (3, 3) with fx != fy."""
    center = ((HW[1] - 1) / 2 + 31.3 * off_center, (HW[0] - 1) / 2 - 22.7 * off_center)
    return np.array([[310.0, 0, center[0]], [0, 290.0, center[1]], [0, 0, 1]])


def projected(camera: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixels (M, 2) of points (M, 3) in the camera frame."""
    px = points @ camera.T
    divided: np.ndarray = px[:, :2] / px[:, 2:]
    return divided


def blob(px: np.ndarray) -> np.ndarray:
    """A white Gaussian at a pixel, (H, W, 3) float32 in [0, 1]."""
    y, x = np.mgrid[: HW[0], : HW[1]]
    picture = np.exp(-((x - px[0]) ** 2 + (y - px[1]) ** 2) / (2 * 6.0**2))
    return np.repeat(picture[..., None], 3, axis=2).astype(np.float32)


def brightness_center(picture: np.ndarray) -> np.ndarray:
    """The centre of brightness x, y of a picture (H, W, 3), in px."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    weight = np.clip(picture[..., 0].astype(float) - 0.02, 0, None)
    center: np.ndarray = np.array([(x * weight).sum(), (y * weight).sum()]) / max(
        float(weight.sum()), 1e-9
    )
    return center


def ours(
    pipeline: list[object], picture: np.ndarray, camera: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The picture and the projections by this package."""
    image, after = Compose(pipeline)(
        picture, {"K": camera, "corners_3d": points[None], "image_id": "blob"}, key=(0, 1)
    )
    order = [3, 2, 1, 0, 7, 6, 5, 4] if after["mirrored"] else list(range(8))
    return image, projected(after["K"], after["corners_3d"][0][order])


def with_kornia(
    op: K.GeometricAugmentationBase2D, picture: np.ndarray, camera: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The picture by kornia's AugmentationSequential.

    K rides along under a key of its own, which passes unchanged.
    """
    sequence = K.AugmentationSequential(op, data_keys=None)
    output = sequence(
        {
            "image": torch.from_numpy(picture).permute(2, 0, 1)[None],
            "K": torch.from_numpy(camera)[None],
        }
    )
    return output["image"][0].permute(1, 2, 0).numpy(), projected(output["K"][0].numpy(), points)


def scaled(camera: np.ndarray, x: float, y: float) -> np.ndarray:
    """Rows 0 and 1 of K times the factors (corner).

    The rule of vision3d 0.5.2 and of many detectors' loaders.
    """
    K_scaled: np.ndarray = camera * np.array([[x], [y], [1.0]])
    return K_scaled


def recentred(camera: np.ndarray, cx: float, cy: float | None = None) -> np.ndarray:
    """K with another principal point; cy as it was if it is left out."""
    K_new = camera.copy()
    K_new[0, 2], K_new[1, 2] = cx, camera[1, 2] if cy is None else cy
    return K_new


def resized(picture: np.ndarray, image_hw: tuple[int, int]) -> np.ndarray:
    """The picture in another size, by OpenCV."""
    interpolation = cv2.INTER_LINEAR if image_hw[0] > HW[0] else cv2.INTER_AREA
    return cv2.resize(picture, (image_hw[1], image_hw[0]), interpolation=interpolation)


Rule = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Of (picture, K, points): the moved picture, and the predicted px of the points."""


def flip_rules() -> dict[str, Rule]:
    """The rules for a horizontal flip."""
    width = HW[1]
    return {
        "animal3dbox": lambda p, c, q: ours([RandomHorizontalFlip(1)], p, c, q),
        "kornia as it is, K as a key": lambda p, c, q: with_kornia(
            K.RandomHorizontalFlip(p=1), p, c, q
        ),
        "cx' = W - cx (corner; vision3d)": lambda p, c, q: (
            p[:, ::-1],
            projected(recentred(c, width - c[0, 2]), q * MIRROR),
        ),
        "cx' = W - 1 - cx": lambda p, c, q: (
            p[:, ::-1],
            projected(recentred(c, width - 1 - c[0, 2]), q * MIRROR),
        ),
        "x mirrored, K left": lambda p, c, q: (p[:, ::-1], projected(c, q * MIRROR)),
    }


def resize_rules(image_hw: tuple[int, int]) -> dict[str, Rule]:
    """The rules for a resize to a size."""
    x, y = image_hw[1] / HW[1], image_hw[0] / HW[0]
    return {
        "animal3dbox": lambda p, c, q: ours([Resize(image_hw)], p, c, q),
        "kornia as it is, K as a key": lambda p, c, q: with_kornia(
            K.Resize(image_hw, p=1), p, c, q
        ),
        "K rows times s (corner; vision3d)": lambda p, c, q: (
            resized(p, image_hw),
            projected(scaled(c, x, y), q),
        ),
        "K times s, c = (c + 1/2) s - 1/2": lambda p, c, q: (
            resized(p, image_hw),
            projected(
                recentred(scaled(c, x, y), (c[0, 2] + 0.5) * x - 0.5, (c[1, 2] + 0.5) * y - 0.5),
                q,
            ),
        ),
    }


def crop_rules() -> dict[str, Rule]:
    """The rules for a crop of the middle, resized to the picture's size."""
    return {
        "animal3dbox": lambda p, c, q: ours(
            [RandomResizedCrop(HW, (0.25, 0.25), keep_part=0)], p, c, q
        ),
        "c - (left, top), rows times s (corner; vision3d)": lambda p, c, q: (
            cv2.resize(p[60:180, 80:240], (HW[1], HW[0])),
            projected(scaled(recentred(c, c[0, 2] - 80, c[1, 2] - 60), 2, 2), q),
        ),
    }


def turn_rules() -> dict[str, Rule]:
    """The rules for a turn by 20 degrees about the middle."""
    return {
        "animal3dbox": lambda p, c, q: ours([RandomRotation((20, 20))], p, c, q),
        "kornia as it is, K as a key": lambda p, c, q: with_kornia(
            K.RandomRotation((20.0, 20.0), p=1), p, c, q
        ),
    }


def cases() -> dict[str, dict[str, Rule]]:
    """For each operation, the rules to compare."""
    halving = resize_rules((120, 160))
    return {
        "horizontal flip": flip_rules(),
        "resize x 1.6, y 1.5": resize_rules((360, 512)),
        "resize to a half": {name: halving[name] for name in list(halving)[:3]},
        "crop, then resize to 2 x": crop_rules(),
        "turn by 20 degrees about the middle": turn_rules(),
    }


def worst(rule: Rule, off_center: bool) -> float:
    """The greatest distance in px along x or y between a blob and its prediction.

    Over the corners that the moved picture shows, not at its edge.
    """
    camera, misses = intrinsics(off_center), []
    for number, px in enumerate(projected(camera, CORNERS)):
        image, predicted = rule(blob(px), camera, CORNERS)
        center = brightness_center(image)
        edge = 30 * max(image.shape[0] / HW[0], 1)
        if (center > edge).all() and (center < np.array(image.shape[1::-1]) - edge).all():
            misses.append(np.abs(center - predicted[number]).max())
    return float(max(misses))


def main() -> None:
    """Print the table of docs/transforms.md."""
    torch.manual_seed(0)
    print(
        f"kornia {version('kornia')}, OpenCV {cv2.__version__}; worst corner in px, centred /"
        " off-centre principal point"
    )
    for operation, rules in cases().items():
        for name, rule in rules.items():
            print(f"| {operation} | {name} | {worst(rule, False):.3f} | {worst(rule, True):.3f} |")


if __name__ == "__main__":
    main()
