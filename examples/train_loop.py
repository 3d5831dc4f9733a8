"""A training loop on a synthetic world with a toy network.

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

TASKS = (
    ("corners_3d", 24),
    ("corners_2d", 16),
    ("face_visible", 6),
    ("face_share", 6),
    ("truncation", 1),
)


class Toy(torch.nn.Module):
    """For each 2D box (xyxy px) the features at its middle, read out as all tasks and the class."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.features = torch.nn.Sequential(
            torch.nn.Conv2d(3, 16, 5, 4),
            torch.nn.ReLU(),
            torch.nn.Conv2d(16, 32, 3, 2),
            torch.nn.ReLU(),
        )
        self.widths = [width for _, width in TASKS] + [classes]
        self.head = torch.nn.Linear(32, sum(self.widths))

    def forward(self, images: torch.Tensor, boxes: list[torch.Tensor]) -> tuple[torch.Tensor, ...]:
        """Raw outputs of the heads, one row a box."""
        places = [
            ((box[:, :2] + box[:, 2:] + 1) / images.shape[-1] - 1)[None, :, None] for box in boxes
        ]
        pairs = zip(self.features(images.float() / 255), places, strict=True)
        found = [
            fn.grid_sample(features[None], place, align_corners=False)[0, :, :, 0].T
            for features, place in pairs
        ]
        return torch.split_with_sizes(self.head(torch.cat(found)), self.widths, 1)


def loss_of(out: tuple[torch.Tensor, ...], target: dict[str, torch.Tensor]) -> torch.Tensor:
    """All tasks together.

    3D corners about the centre in box sizes, pixels only where a corner is in front of the camera.
    """
    about = (target["corners_3d"] - target["center"][:, None]) / target["size"].norm(dim=1)[
        :, None, None
    ]
    off_px = (out[1].view(-1, 8, 2) - target["corners_2d"] / 100)[target["corner_in_front"]]
    cuboid = fn.smooth_l1_loss(out[0].view(-1, 8, 3), about) + off_px.abs().mean()
    faces = fn.binary_cross_entropy_with_logits(
        out[2], target["face_visible"].float()
    ) + fn.mse_loss(out[3].softmax(1), target["face_share"])
    return (
        cuboid
        + faces
        + fn.mse_loss(out[4][:, 0], target["truncation"])
        + fn.cross_entropy(out[5], target["labels"])
    )


if __name__ == "__main__":  # workers that are spawned import this file
    augment = Compose([RandomHorizontalFlip(), RandomResizedCrop(96), ColorJitter(0.2)], seed=1)
    dataset = SyntheticDataset(
        SyntheticSet(0, 24, replace(WorldConfig(), image_hw=(120, 160))),
        transform=augment,
        on_bad="skip",
    )
    network, sampler = Toy(len(dataset.classes)), EpochSampler(dataset)
    optimizer = torch.optim.Adam(network.parameters(), 1e-2)
    loader = DataLoader(
        dataset, batch_size=8, sampler=sampler, collate_fn=collate_stacked, num_workers=2
    )
    for epoch in range(3):
        sampler.set_epoch(epoch)
        for step, (images, targets) in enumerate(loader):
            check_targets(
                (images, targets), step=step
            )  # a target that contradicts itself stops here, and names its image
            whole = {
                name: torch.cat([t[name] for t in targets])
                for name in (*dict(TASKS), "center", "size", "corner_in_front", "labels")
            }
            loss = loss_of(network(images, [target["boxes"] for target in targets]), whole)
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            optimizer.zero_grad()
        print(f"epoch {epoch}: loss {loss.item():.3f}; {dataset.report()}")
