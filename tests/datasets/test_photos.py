"""Real photographs, where they are at hand.

The Dataset and the command line give them the same labels.
"""

import json
from pathlib import Path

import pytest
import torch

from animal3dbox.cli.main import main
from animal3dbox.datasets import Skipped, StanfordExtraDataset

PHOTOS = Path(__file__).parents[2].parent / "shared" / "photos"


@pytest.mark.skipif(
    not PHOTOS.is_dir(),
    reason=f"the photographs are not at {PHOTOS}; generated data cover the rest",
)
def test_photographs_get_the_same_labels_as_on_the_command_line(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as end:
        main(["label", str(PHOTOS), "--out", str(tmp_path), "--json"])
    assert end.value.code in (0, None)
    rows = {
        row["sample_id"]: row
        for row in json.loads((tmp_path / "labels.json").read_text())["animals"]
    }
    dataset = StanfordExtraDataset(PHOTOS, on_bad="skip")
    seen = 0
    for index in range(len(dataset)):
        sample = dataset[index]
        if isinstance(sample, Skipped):
            continue
        for number, record in enumerate(dataset.source.sample(index).records):
            row, target = rows[record.sample_id], sample[1]
            for name in (
                "corners_3d",
                "center",
                "rotation",
                "size",
                "face_area",
                "face_share",
                "face_share_in_image",
                "R",
                "t",
                "truncation",
            ):
                assert torch.equal(
                    target[name][number], torch.tensor(row[name], dtype=torch.float32)
                ), (record.sample_id, name)
            assert torch.equal(
                target["boxes"][number], torch.tensor(row["box"], dtype=torch.float32)
            )
            assert torch.equal(target["K"], torch.tensor(row["K"], dtype=torch.float32))
            assert target["meta"]["quality"][number]["mask_iou"] == row["quality"]["mask_iou"]
            assert target["meta"]["quality"][number]["K_source"] == row["quality"]["K_source"]
            seen += 1
    assert seen == len(rows) > 0
