"""Augmentation of one image at a time in a worker.

CPU time against kornia as it is and against albumentations.

    python benchmarks/augment.py [--rounds 30]

One thread, 640 x 480 to 512 x 512, side by side in one run: every round times ten calls in a row of
each library, as a worker makes them, on the same image with the same drawn values, and the medians
are compared. Each library starts from the decoded uint8 image and ends with what training takes.
A Dataset of ours gives the decoder's memory as a view (3, H, W), albumentations takes it as (H, W,
3), and kornia is given planes, which suit it best. Times are those of the process's own CPU.

kornia and albumentations move points in pixels only; animal3dbox is timed with the same work
(keypoints only) and with all it does (camera, cuboids, faces, shares, truncation, boxes,
keypoints). albumentations is compared where it is installed (pip install albumentations==2.0.8 into
a copy of the environment).
"""

import argparse
import importlib
import importlib.util
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import kornia.augmentation as K  # noqa: N812
import numpy as np
import torch

from animal3dbox.geometry.box_visibility import corners_in_front, face_visibility
from animal3dbox.geometry.camera import intrinsics, project
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.transforms import (
    ColorJitter,
    Compose,
    Normalize,
    RandomAffine,
    RandomHorizontalFlip,
    RandomResizedCrop,
)

HW, SIZE = (480, 640), 512
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
CALLS = 10
DEGREES, SCALE, AREA, JITTER = 10.0, 1.1, 0.7, 0.3


def target_of(count: int) -> dict[str, Any]:
    """All fields of a target with boxes and 26 keypoints each, float32."""
    rng = torch.Generator().manual_seed(0)
    center = torch.rand(count, 3, generator=rng, dtype=torch.float64) - 0.5
    center[:, 2] += 6
    box = Cuboid(
        center,
        rotation_from_axis_angle(torch.randn(count, 3, generator=rng, dtype=torch.float64)),
        torch.ones(count, 3, dtype=torch.float64),
    )
    camera = intrinsics((700.0, 690.0), HW)
    faces = face_visibility(box, camera, HW)
    middle = project(camera, box.corners())[0].mean(1, keepdim=True)
    keypoints = torch.cat((middle.expand(count, 26, 2), torch.ones(count, 26, 1)), dim=-1)
    target = {
        "corners_3d": box.corners(),
        "center": box.center,
        "rotation": box.rotation,
        "size": box.size,
        "corners_2d": project(camera, box.corners())[0],
        "corner_in_front": corners_in_front(box),
        "face_visible": faces.visible,
        "face_area": faces.area,
        "face_share": faces.share,
        "face_share_in_image": faces.share_in_image,
        "truncation": faces.truncation,
        "behind_camera": torch.zeros(count, dtype=torch.bool),
        "K": camera,
        "R": torch.eye(3).expand(count, 3, 3),
        "t": torch.zeros(count, 3),
        "labels": torch.zeros(count, dtype=torch.int64),
        "keypoints": keypoints,
        "boxes": torch.tensor([[100.0, 100, 300, 300]]).expand(count, 4),
        "keypoint_mirror": torch.arange(26),
    }
    return {
        name: value.float() if value.is_floating_point() else value
        for name, value in target.items()
    }


def ours(colour: bool, image: torch.Tensor, target: dict[str, Any]) -> Callable[[], Any]:
    """Our pipeline: one fused warp, the whole target."""
    steps: list[Any] = [
        RandomHorizontalFlip(1),
        RandomAffine((DEGREES, DEGREES), scale=(SCALE, SCALE)),
        RandomResizedCrop(SIZE, (AREA, AREA)),
    ]
    steps += [ColorJitter(JITTER, JITTER, JITTER), Normalize(MEAN, STD)] if colour else []
    compose = Compose(steps)
    return lambda: compose(image, target, key=(0, 0))


def with_kornia(colour: bool, image: torch.Tensor, target: dict[str, Any]) -> Callable[[], Any]:
    """Time kornia's AugmentationSequential as it is.

    Of the target it moves the corners and keypoints in pixels only.
    """
    area = AREA * min(HW) ** 2 / (HW[0] * HW[1])
    steps: list[Any] = [
        K.RandomHorizontalFlip(p=1),
        K.RandomAffine((DEGREES, DEGREES), scale=(SCALE, SCALE), p=1),
        K.RandomResizedCrop((SIZE, SIZE), scale=(area, area), ratio=(1.0, 1.0), p=1),
    ]
    steps += (
        [
            K.ColorJitter(JITTER, JITTER, JITTER, 0.0, p=1),
            K.Normalize(torch.tensor(MEAN), torch.tensor(STD)),
        ]
        if colour
        else []
    )
    sequence = K.AugmentationSequential(*steps, data_keys=["input", "keypoints"])
    points = torch.cat(
        (target["corners_2d"].reshape(1, -1, 2), target["keypoints"][..., :2].reshape(1, -1, 2)),
        dim=1,
    )
    return lambda: sequence(image[None].float() / 255, points)


def with_albumentations(
    colour: bool, image: np.ndarray, target: dict[str, Any]
) -> Callable[[], Any]:
    """Time albumentations with keypoints; it knows no camera."""
    A: Any = importlib.import_module("albumentations")
    area = AREA * min(HW) ** 2 / (HW[0] * HW[1])
    steps: list[Any] = [
        A.HorizontalFlip(p=1),
        A.Affine(rotate=(DEGREES, DEGREES), scale=(SCALE, SCALE), p=1),
        A.RandomResizedCrop((SIZE, SIZE), scale=(area, area), ratio=(1.0, 1.0), p=1),
    ]
    steps += (
        [
            A.ColorJitter(
                (1 - JITTER, 1 + JITTER),
                (1 - JITTER, 1 + JITTER),
                (1 - JITTER, 1 + JITTER),
                (0, 0),
                p=1,
            ),
            A.Normalize(MEAN, STD),
        ]
        if colour
        else []
    )
    pipeline = A.Compose(
        steps, keypoint_params=A.KeypointParams(format="xy", remove_invisible=False)
    )
    points = torch.cat(
        (target["corners_2d"].reshape(-1, 2), target["keypoints"][..., :2].reshape(-1, 2))
    ).numpy()

    def run() -> Any:
        """The tensor that a training step takes, and the points."""
        output = pipeline(image=image, keypoints=points)
        return (
            torch.from_numpy(np.ascontiguousarray(output["image"].transpose(2, 0, 1))),
            output["keypoints"],
        )

    return run


def medians(runs: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Milliseconds of CPU a call, the median over rounds of CALLS calls each."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(rounds + 2):
        for name, run in runs.items():
            run()
            start = time.process_time()
            for _ in range(CALLS):
                run()
            if turn >= 2:
                times[name].append((time.process_time() - start) * 1e3 / CALLS)
    return {name: float(np.median(values)) for name, values in times.items()}


def machine() -> str:
    """The processor's name, if the system tells it, its cores, and how busy they are."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return f"{names[0] if names else 'unknown processor'}, {os.cpu_count()} cores, load {load}"


def main() -> None:
    """Print a table of both pipelines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=30)
    rounds = parser.parse_args().rounds
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    smooth = cv2.GaussianBlur(np.random.default_rng(0).random((*HW, 3)) * 255, (0, 0), 3)
    array = cv2.normalize(smooth, smooth, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    image = torch.from_numpy(array).permute(2, 0, 1)
    target = target_of(2)
    print(machine())
    print(
        f"OpenCV {cv2.__version__}, torch {torch.__version__}, one thread, 640x480 -> 512x512,"
        " target with 2 boxes and 52 keypoints"
    )
    for title, colour in (
        ("flip + affine + crop", False),
        ("the same + colour jitter + normalise", True),
    ):
        points = {name: target[name] for name in ("keypoints", "keypoint_mirror", "labels")}
        runs = {
            "all targets": ours(colour, image, target),
            "keypoints only": ours(colour, image, points),
        }
        runs["kornia"] = with_kornia(colour, image.contiguous(), target)
        if importlib.util.find_spec("albumentations"):
            runs["albumentations"] = with_albumentations(colour, array, target)
        result = medians(runs, rounds)
        print(f"{title}: " + ", ".join(f"{name} {ms:.2f} ms" for name, ms in result.items()))
        for mine in ("all targets", "keypoints only"):
            ratios = ", ".join(
                f"{name} {result[name] / result[mine]:.1f}x"
                for name in ("kornia", "albumentations")
                if name in result
            )
            print(f"    against animal3dbox with {mine}: {ratios}")
    if not importlib.util.find_spec("albumentations"):
        print("albumentations is not installed here")


if __name__ == "__main__":
    main()
