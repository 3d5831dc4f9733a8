"""A training loop on a synthetic world with a toy network.

Run: python examples/train_loop.py

Put your Dataset, such as Animal3DDataset, and your network in their places.
"""

from dataclasses import replace

import torch
from torch.nn import functional as fn
from torch.utils.data import DataLoader

from animal3dbox.datasets import SyntheticDataset, SyntheticSet, collate_stacked
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.training import EpochSampler, check_targets
from animal3dbox.transforms import ColorJitter, Compose, RandomHorizontalFlip, RandomResizedCrop

TASKS = {"corners_3d": 24, "corners_2d": 16, "face_visible": 6, "face_share": 6, "truncation": 1}
FIELDS = (*TASKS, "center", "size", "corner_in_front", "labels")


class ToyNetwork(torch.nn.Module):
    """For each 2D box (xyxy px) the features at its middle, read out as all tasks and the class."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        first, second = torch.nn.Conv2d(3, 16, 5, 4), torch.nn.Conv2d(16, 32, 3, 2)
        self.features = torch.nn.Sequential(first, torch.nn.ReLU(), second, torch.nn.ReLU())
        self.widths = [*TASKS.values(), classes]
        self.head = torch.nn.Linear(32, sum(self.widths))

    def forward(self, images: torch.Tensor, boxes: list[torch.Tensor]) -> tuple[torch.Tensor, ...]:
        """Raw outputs of the heads, one row a box."""
        at_boxes = []
        for features, box in zip(self.features(images.float() / 255), boxes, strict=True):
            middle = (box[:, :2] + box[:, 2:] + 1) / images.shape[-1] - 1
            grid = middle[None, :, None]
            at_boxes.append(fn.grid_sample(features[None], grid, align_corners=False)[0, :, :, 0].T)
        return torch.split_with_sizes(self.head(torch.cat(at_boxes)), self.widths, 1)


def loss_of(out: tuple[torch.Tensor, ...], target: dict[str, torch.Tensor]) -> torch.Tensor:
    """The sum of the losses of all tasks.

    3D corners about the centre in box sizes, pixels only where a corner is in front of the camera.
    """
    corners, corners_px, visible, share, truncation, classes = out
    diagonal = target["size"].norm(dim=1)[:, None, None]
    corners_box = (target["corners_3d"] - target["center"][:, None]) / diagonal
    off_px = corners_px.view(-1, 8, 2) - target["corners_2d"] / 100
    return (
        fn.smooth_l1_loss(corners.view(-1, 8, 3), corners_box)
        + off_px[target["corner_in_front"]].abs().mean()
        + fn.binary_cross_entropy_with_logits(visible, target["face_visible"].float())
        + fn.mse_loss(share.softmax(1), target["face_share"])
        + fn.mse_loss(truncation[:, 0], target["truncation"])
        + fn.cross_entropy(classes, target["labels"])
    )


def main() -> None:
    """Train for three epochs and print the loss of each."""
    world = SyntheticSet(0, 24, replace(WorldConfig(), image_hw=(120, 160)))
    augment = Compose([RandomHorizontalFlip(), RandomResizedCrop(96), ColorJitter(0.2)], seed=1)
    dataset = SyntheticDataset(world, transform=augment, on_bad="skip")
    sampler = EpochSampler(dataset)
    loader = DataLoader(dataset, 8, sampler=sampler, collate_fn=collate_stacked, num_workers=2)
    network = ToyNetwork(len(dataset.classes))
    optimizer = torch.optim.Adam(network.parameters(), 1e-2)
    for epoch in range(3):
        sampler.set_epoch(epoch)
        for step, (images, targets) in enumerate(loader):
            # A target that contradicts itself stops here, and names its image.
            check_targets((images, targets), step=step)
            batch = {name: torch.cat([target[name] for target in targets]) for name in FIELDS}
            loss = loss_of(network(images, [target["boxes"] for target in targets]), batch)
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            optimizer.zero_grad()
        print(f"epoch {epoch}: loss {loss.item():.3f}; {dataset.report()}")


if __name__ == "__main__":  # workers that are spawned import this file
    main()
