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
    """Pixels (M, 2)."""
    px = points @ camera.T
    divided: np.ndarray = px[:, :2] / px[:, 2:]
    return divided


def blob(px: np.ndarray) -> np.ndarray:
    """A white Gaussian at a pixel, (H, W, 3) float32 in [0, 1]."""
    y, x = np.mgrid[: HW[0], : HW[1]]
    picture = np.exp(-((x - px[0]) ** 2 + (y - px[1]) ** 2) / (2 * 6.0**2))
    return np.repeat(picture[..., None], 3, axis=2).astype(np.float32)


def found(picture: np.ndarray) -> np.ndarray:
    """The centre of brightness."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    weight = np.clip(picture[..., 0].astype(float) - 0.02, 0, None)
    center: np.ndarray = np.array([(x * weight).sum(), (y * weight).sum()]) / max(
        float(weight.sum()), 1e-9
    )
    return center


def ours(
    pipeline: list[object], picture: np.ndarray, camera: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Picture and projections by this package."""
    made, after = Compose(pipeline)(
        picture, {"K": camera, "corners_3d": points[None], "image_id": "blob"}, key=(0, 1)
    )
    order = [3, 2, 1, 0, 7, 6, 5, 4] if after["mirrored"] else list(range(8))
    return made, projected(after["K"], after["corners_3d"][0][order])


def with_kornia(
    op: K.GeometricAugmentationBase2D, picture: np.ndarray, camera: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Picture by kornia's AugmentationSequential.

    K rides along under a key of its own, which passes unchanged.
    """
    sequence = K.AugmentationSequential(op, data_keys=None)
    moved = sequence(
        {
            "image": torch.from_numpy(picture).permute(2, 0, 1)[None],
            "K": torch.from_numpy(camera)[None],
        }
    )
    return moved["image"][0].permute(1, 2, 0).numpy(), projected(moved["K"][0].numpy(), points)


def scaled(camera: np.ndarray, x: float, y: float) -> np.ndarray:
    """Rows 0 and 1 of K times the factors, the rule of vision3d 0.5.2 and of many detectors'
    loaders (corner)."""
    changed: np.ndarray = camera * np.array([[x], [y], [1.0]])
    return changed


Rule = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def cases() -> dict[str, dict[str, Rule]]:
    """For each operation, the rules to compare.

    Functions of (picture, K, points) to (picture, predicted px).
    """
    wide = (360, 512)
    x, y = wide[1] / HW[1], wide[0] / HW[0]
    half = (120, 160)

    def resized(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        return cv2.resize(
            picture,
            (size[1], size[0]),
            interpolation=cv2.INTER_LINEAR if size[0] > HW[0] else cv2.INTER_AREA,
        )

    def moved(camera: np.ndarray, **entries: float) -> np.ndarray:
        changed = camera.copy()
        for name, value in entries.items():
            changed[{"cx": 0, "cy": 1}[name], 2] = value
        return changed

    return {
        "horizontal flip": {
            "animal3dbox": lambda p, c, q: ours([RandomHorizontalFlip(1)], p, c, q),
            "kornia as it is, K as a key": lambda p, c, q: with_kornia(
                K.RandomHorizontalFlip(p=1), p, c, q
            ),
            "cx' = W - cx (corner; vision3d)": lambda p, c, q: (
                p[:, ::-1],
                projected(moved(c, cx=HW[1] - c[0, 2]), q * MIRROR),
            ),
            "cx' = W - 1 - cx": lambda p, c, q: (
                p[:, ::-1],
                projected(moved(c, cx=HW[1] - 1 - c[0, 2]), q * MIRROR),
            ),
            "x mirrored, K left": lambda p, c, q: (p[:, ::-1], projected(c, q * MIRROR)),
        },
        "resize x 1.6, y 1.5": {
            "animal3dbox": lambda p, c, q: ours([Resize(wide)], p, c, q),
            "kornia as it is, K as a key": lambda p, c, q: with_kornia(
                K.Resize(wide, p=1), p, c, q
            ),
            "K rows times s (corner; vision3d)": lambda p, c, q: (
                resized(p, wide),
                projected(scaled(c, x, y), q),
            ),
            "K times s, c = (c + 1/2) s - 1/2": lambda p, c, q: (
                resized(p, wide),
                projected(
                    moved(
                        scaled(c, x, y), cx=(c[0, 2] + 0.5) * x - 0.5, cy=(c[1, 2] + 0.5) * y - 0.5
                    ),
                    q,
                ),
            ),
        },
        "resize to a half": {
            "animal3dbox": lambda p, c, q: ours([Resize(half)], p, c, q),
            "kornia as it is, K as a key": lambda p, c, q: with_kornia(
                K.Resize(half, p=1), p, c, q
            ),
            "K rows times s (corner; vision3d)": lambda p, c, q: (
                resized(p, half),
                projected(scaled(c, 0.5, 0.5), q),
            ),
        },
        "crop, then resize to 2 x": {
            "animal3dbox": lambda p, c, q: ours(
                [RandomResizedCrop(HW, (0.25, 0.25), keep_part=0)], p, c, q
            ),
            "c - (left, top), rows times s (corner; vision3d)": lambda p, c, q: (
                cv2.resize(p[60:180, 80:240], (HW[1], HW[0])),
                projected(scaled(moved(c, cx=c[0, 2] - 80, cy=c[1, 2] - 60), 2, 2), q),
            ),
        },
        "turn by 20 degrees about the middle": {
            "animal3dbox": lambda p, c, q: ours([RandomRotation((20, 20))], p, c, q),
            "kornia as it is, K as a key": lambda p, c, q: with_kornia(
                K.RandomRotation((20.0, 20.0), p=1), p, c, q
            ),
        },
    }


def worst(rule: Rule, off_center: bool) -> float:
    """The greatest distance along x or y between a blob and its prediction, over the corners seen,
    in px."""
    camera, misses = intrinsics(off_center), []
    for number, px in enumerate(projected(camera, CORNERS)):
        made, predicted = rule(blob(px), camera, CORNERS)
        center = found(made)
        edge = 30 * max(made.shape[0] / HW[0], 1)
        if (center > edge).all() and (center < np.array(made.shape[1::-1]) - edge).all():
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
