"""The same kind of detector as a LightningModule: targets, metrics and order of epochs from here.

Run: python examples/lightning_module.py

It needs `pip install 'animal3dbox[lightning]'`. Put your Datasets in the place of the toy worlds.
"""

from typing import Any

import pytorch_lightning as pl
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from animal3dbox.datasets import LabelDataset, SyntheticDataset
from animal3dbox.training import EpochSampler
from animal3dbox.training.detector_targets import BoxCoder, BoxCrops, crop_boxes
from animal3dbox.training.metrics.torchmetrics_door import TorchBoxMetrics

FIELDS = {"center_offset": 2, "log_depth": 1, "log_size": 3, "rotation_6d": 6}
Targets = list[dict[str, Any]]


class BoxModule(pl.LightningModule):
    """A small network on crops by the true 2D boxes, judged by TorchBoxMetrics."""

    def __init__(self, rate: float = 1e-3) -> None:
        super().__init__()
        self.save_hyperparameters()
        self.coder = BoxCoder(virtual_focal_px=500.0)
        layers: list[nn.Module] = []
        for wide, out in ((3, 16), (16, 32), (32, 64)):
            layers += [nn.Conv2d(wide, out, 3, 2, 1), nn.BatchNorm2d(out), nn.ReLU()]
        head = nn.Linear(64, sum(FIELDS.values()))
        self.network = nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), head)
        self.metrics = TorchBoxMetrics(
            pair_by="boxes", class_agnostic=True, relative=False, resamples=0
        )

    def forward(self, crops: BoxCrops) -> dict[str, Tensor]:
        """What BoxCoder decodes, of each crop."""
        numbers = self.network(crops.pixels.float() / 127.5 - 1)
        parts = torch.split_with_sizes(numbers, [*FIELDS.values()], 1)
        out = dict(zip(FIELDS, parts, strict=True))
        return {**out, "log_depth": out["log_depth"][:, 0]}

    def training_step(self, batch: tuple[Any, Targets], number: int) -> Tensor:
        """The loss of a batch: each encoded field's mean error."""
        images, targets = batch
        crops = crop_boxes(images, targets, (64, 64))
        fields = {
            name: torch.cat([one[name] for one in targets])
            for name in ("center", "rotation", "size")
        }
        true = self.coder.encode({**fields, "boxes": crops.boxes, "K": crops.K})
        out = self(crops)
        loss = torch.stack([(out[name] - true[name]).abs().mean() for name in FIELDS]).sum()
        self.log("loss", loss, batch_size=len(targets))
        return loss

    def validation_step(self, batch: tuple[Any, Targets], number: int) -> None:
        """Add a batch to the metrics."""
        images, targets = batch
        crops = crop_boxes(images, targets, (64, 64))
        boxes = self.coder.decode(self(crops), boxes=crops.boxes, K=crops.K)
        counts = [len(target["boxes"]) for target in targets]
        parts = {
            name: torch.split_with_sizes(boxes[name], counts)
            for name in ("center", "rotation", "size")
        }
        predictions = [
            {name: part[k] for name, part in parts.items()}
            | {"boxes": target["boxes"], "scores": torch.ones(counts[k], device=self.device)}
            for k, target in enumerate(targets)
        ]
        self.metrics.update(predictions, targets)

    def on_validation_epoch_end(self) -> None:
        """Log what is known; a logger takes no None."""
        known = {name: one for name, one in self.metrics.compute().items() if one is not None}
        self.log_dict({f"val_{name}": float(one) for name, one in known.items()})
        self.metrics.reset()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """AdamW at the rate of the hyperparameters."""
        return torch.optim.AdamW(self.parameters(), self.hparams["rate"])


class Epochs(pl.Callback):
    """Tells an EpochSampler which epoch begins: its order is the same in every run."""

    def __init__(self, sampler: EpochSampler) -> None:
        self.sampler = sampler

    def on_train_epoch_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Before the loader is asked."""
        self.sampler.set_epoch(trainer.current_epoch)


def loader_of(dataset: LabelDataset, sampler: EpochSampler | None = None) -> DataLoader[Any]:
    """Batches of eight images."""
    return DataLoader(dataset, 8, sampler=sampler, collate_fn=dataset.collate_fn)


def main() -> None:
    """Train for two epochs on a toy world and print what another one's animals say."""
    pl.seed_everything(0)
    train, val = (SyntheticDataset(16, seed=seed, image_hw=(96, 128)) for seed in (0, 1))
    sampler = EpochSampler(train)
    trainer = pl.Trainer(
        max_epochs=2, accelerator="cpu", logger=False, enable_progress_bar=False,
        callbacks=[Epochs(sampler)], use_distributed_sampler=False, num_sanity_val_steps=0,
    )  # fmt: skip
    trainer.fit(BoxModule(), loader_of(train, sampler), loader_of(val))
    for name in ("val_heading_median_deg", "val_flank_accuracy", "val_pairs"):
        print(f"{name}: {float(trainer.callback_metrics[name]):.3f}")


if __name__ == "__main__":
    main()
