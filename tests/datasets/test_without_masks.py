"""A Dataset whose targets hold no masks: what it still decodes, and that labels stay the same."""

from pathlib import Path
from typing import Any

import pytest
from loading import in_bytes
from small_animals import small_dataset
from torch import Tensor

from animal3dbox.datasets import LabelDataset, Skipped
from animal3dbox.datasets.images.masks import record_mask
from animal3dbox.datasets.labelling import image_samples
from animal3dbox.datasets.labelling.skipped import Target


def sample(dataset: LabelDataset) -> tuple[Tensor, Target]:
    first = dataset[0]
    assert not isinstance(first, Skipped)
    return first


def test_labels_are_the_same_where_targets_hold_no_masks(animals: Path) -> None:
    image, target = sample(small_dataset(animals))
    same_image, without = sample(small_dataset(animals, masks=False))
    assert target.pop("masks").any()
    assert in_bytes((same_image, without)) == in_bytes((image, target))


@pytest.mark.parametrize("cached", [True, False])
def test_without_masks_none_is_decoded_but_to_make_a_label(
    animals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cached: bool
) -> None:
    options = {"cache": tmp_path} if cached else {}
    plain = small_dataset(animals, masks=False, **options)
    before = [in_bytes(plain[index]) for index in range(len(plain))]
    decoded = []

    def watched(*arguments: Any, **options: Any) -> Any:
        decoded.append(options["sample_id"])
        return record_mask(*arguments, **options)

    monkeypatch.setattr(image_samples, "record_mask", watched)
    again = small_dataset(animals, masks=False, **options)
    assert [in_bytes(again[index]) for index in range(len(again))] == before
    assert bool(decoded) is not cached  # a label that is made is made with its mask
    with_masks = small_dataset(animals, **options)
    assert "masks" in sample(with_masks)[1]
    assert decoded
