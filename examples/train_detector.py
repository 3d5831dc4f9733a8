"""Train a detector of oriented boxes on crops, and judge it on other animals in other scenes.

Run: python examples/train_detector.py [FOLDER] [--out OUT_DIR]

FOLDER is bench-v1 (`animal3dbox bench make FOLDER`); without it a toy world shows the way. OUT_DIR
keeps crops, checkpoints and pictures: training goes on where it was. docs/teach.md has results.
"""

import argparse
from pathlib import Path
from typing import Any

import cv2
import torch
from torch import Tensor, nn
from torch.optim.lr_scheduler import OneCycleLR

from animal3dbox.datasets import LabelDataset, Omni3DDataset, SyntheticDataset
from animal3dbox.report import draw_predictions
from animal3dbox.training import EpochSampler
from animal3dbox.training.detector_targets import BoxCoder, CropViews, DirectionBins, StoredCrops
from animal3dbox.training.metrics import BoxMetrics

Fields = dict[str, Tensor]
CODER, BINS = BoxCoder(virtual_focal_px=1000.0), DirectionBins(count=64)
BATCH, RATE, SHOWN = 64, 2e-3, ("heading_median_deg", "flank_accuracy", "flank_count")


class Detector(nn.Module):
    """From views (N, 3, 64, 64) to BoxCoder's numbers, with a rotation for each direction."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.PixelUnshuffle(4))  # 4 x 4 px become one of 48 channels
        widths, strides = (48, 32, 64, 64, 128, 128, 256, 256), (1, 1, 1, 2, 1, 2, 1)
        for wide, out, stride in zip(widths, widths[1:], strides, strict=False):
            convolution = nn.Conv2d(wide, out, 3, stride, 1, bias=False)
            self.layers.extend((convolution, nn.BatchNorm2d(out), nn.ReLU()))
        self.layers.extend((nn.AdaptiveAvgPool2d(1), nn.Flatten()))
        self.head = nn.Linear(256, BINS.count * 7 + 6)

    def forward(self, pixels: Tensor) -> Fields:
        """`direction` (N, bins), `rotation_6d` (N, bins, 6), and BoxCoder's other fields."""
        pixels = pixels.contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16):
            numbers = self.head(self.layers(pixels)).float()
        return {
            "direction": numbers[:, : BINS.count],
            "rotation_6d": numbers[:, BINS.count : -6].view(-1, BINS.count, 6),
            "center_offset": numbers[:, -6:-4],
            "log_depth": numbers[:, -4],
            "log_size": numbers[:, -3:],
        }


def loss_of(out: Fields, target: Fields) -> Tensor:
    """The loss of a batch, to which each crop counts by its `weight` (N,)."""
    true = CODER.encode(target)
    likely, place = BINS.likelihoods(true["rotation_6d"]), BINS.nearest(true["rotation_6d"])
    loss = nn.functional.cross_entropy(out["direction"], likely, reduction="none")
    out = {**out, "rotation_6d": out["rotation_6d"][torch.arange(len(place)), place]}
    for name in ("rotation_6d", "center_offset", "log_depth", "log_size"):
        loss = loss + (out[name] - true[name]).abs().view(len(place), -1).mean(1)
    return (loss * target["weight"]).sum() / target["weight"].sum()


@torch.no_grad()
def predict(detector: nn.Module, crops: StoredCrops) -> Fields:
    """The boxes that a detector sees in crops, in the camera frames of their images."""
    parts: list[Fields] = []
    for rows in torch.arange(len(crops)).tensor_split(len(crops) // 256 + 1):
        pixels, seen = CropViews().plain(crops.pixels[rows], crops.at(rows).truth)
        out, mirrored = detector(pixels), detector(pixels.flip(3))
        likely = out["direction"].softmax(1) + BINS.unmirrored(mirrored["direction"].softmax(1))
        scores, place = likely.max(1)
        out["rotation_6d"] = out["rotation_6d"][torch.arange(len(rows)), place]
        parts.append({**CODER.decode(out, boxes=seen["boxes"], K=seen["K"]), "scores": scores / 2})
    return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}


def train(
    crops: StoredCrops, path: Path, views: CropViews, *, seed: int, epochs: int, pause: int = 0
) -> nn.Module:
    """Train from where the checkpoint is: the weights are the same as without a pause."""
    run: Any = {"epochs": epochs, "seed": seed, "views": repr(views), "crops": crops.digest}
    first, kept, *states = torch.load(path) if path.exists() else [0, run]
    if epochs < 1 or kept != run:
        raise SystemExit(f"{path} must be of {run}, epochs >= 1: take another --out, or delete it")
    torch.manual_seed(seed)
    detector = Detector()
    optimizer = torch.optim.AdamW(detector.parameters(), RATE, weight_decay=0.05)
    sampler = EpochSampler(crops, seed=seed)
    rate = OneCycleLR(optimizer, RATE, epochs * -(-len(crops) // BATCH), pct_start=0.2)
    parts: list[Any] = [detector, optimizer, rate]
    for part, state in zip(parts, states, strict=False):
        part.load_state_dict(state)
    for epoch in range(first, pause or epochs):
        sampler.set_epoch(epoch)
        rng = torch.Generator().manual_seed(1000 * seed + epoch)
        order = torch.tensor([number for _, number in sampler])
        for some in map(crops.at, order.split(BATCH)):  # type: ignore[no-untyped-call]
            pixels, target = views.drawn(some.pixels, some.truth, rng)
            optimizer.zero_grad()
            loss_of(detector(pixels), target).backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            rate.step()
        torch.save([epoch + 1, run, *(part.state_dict() for part in parts)], f"{path}.part")
        Path(f"{path}.part").replace(path)
    return detector.eval()


def draw(dataset: LabelDataset, crops: StoredCrops, boxes: Fields, path: Path) -> None:
    """Six images with true boxes, solid, and predicted ones, dashed."""
    sheet = []
    for number, predicted in list(zip(crops.images, crops.by_image(boxes)[0], strict=True))[:6]:
        image, target = dataset[number]  # type: ignore[misc]
        sheet.append(draw_predictions(image, target, predicted, least_score=0.0)[..., ::-1])
    cv2.imwrite(str(path), cv2.vconcat([cv2.hconcat(sheet[:3]), cv2.hconcat(sheet[3:])]))


def main() -> None:
    """Train a detector a seed on the first split, and print its errors of the others."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--out", type=Path, default=Path("detector"))
    parser.add_argument("--splits", nargs="+", default=["train", "test-id", "test-species"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--epochs", type=int, default=10)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    datasets: dict[str, LabelDataset] = {}
    for seed, name in enumerate(options.splits):
        datasets[name] = SyntheticDataset(16, seed=seed, image_hw=(120, 160))
        if options.folder is not None:
            datasets[name] = Omni3DDataset(options.folder / "truth" / f"{name}.json")
    stored = {name: StoredCrops.kept(one, options.out / name) for name, one in datasets.items()}
    train_crops = stored.pop(options.splits[0])
    for seed in options.seeds:
        path = options.out / f"seed-{seed}.pt"
        detector = train(train_crops, path, CropViews(), seed=seed, epochs=options.epochs)
        for name, crops in stored.items():
            boxes = predict(detector, crops)
            metrics = BoxMetrics(pair_by="boxes", class_agnostic=True, relative=False)
            metrics.update(*crops.by_image(boxes))
            print(f"seed {seed}, {name}: {', '.join(SHOWN)} =", *map(metrics.compute().get, SHOWN))
            draw(datasets[name], crops, boxes, options.out / f"{name}-{seed}.jpg")


if __name__ == "__main__":
    main()
