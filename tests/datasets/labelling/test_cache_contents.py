"""What a cached label was made from: a change of any of it is another label."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from coco_dataset import coco_content, write_coco
from small_animals import HW

from animal3dbox.datasets import (
    CocoKeypointsDataset,
    LabelDataset,
    Skipped,
    SyntheticDataset,
    SyntheticSet,
)
from animal3dbox.datasets.labelling import synthetic_source
from animal3dbox.datasets.synthetic.scenes import synthetic_scene
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


def box_of(dataset: LabelDataset) -> torch.Tensor:
    sample = dataset[0]
    assert not isinstance(sample, Skipped)
    return torch.cat((sample[1]["rotation"].flatten(), sample[1]["center"].flatten()))


def without(vocabulary: Vocabulary, *keypoints: str) -> Vocabulary:
    """The same keypoints, some of which have no place on the body."""
    places = tuple(
        () if keypoint in keypoints else names
        for keypoint, names in zip(vocabulary.keypoints, vocabulary.landmarks, strict=True)
    )
    return replace(vocabulary, landmarks=places)


@pytest.mark.parametrize("named", ["ap10k17", "mine"])
def test_another_vocabulary_is_not_given_the_first_one_s_labels(tmp_path: Path, named: str) -> None:
    write_coco(tmp_path, coco_content(tmp_path))
    first = VOCABULARIES["ap10k17"]
    other = replace(without(first, "neck", "left_elbow", "right_elbow"), name=named)
    before = box_of(
        CocoKeypointsDataset(tmp_path, vocabulary=first, cache=tmp_path / "cache", on_bad="skip")
    )
    cached, fresh = (
        box_of(CocoKeypointsDataset(tmp_path, vocabulary=other, cache=cache, on_bad="skip"))
        for cache in (tmp_path / "cache", None)
    )
    assert not torch.equal(before, fresh)
    assert torch.equal(cached, fresh)


def test_scenes_that_are_drawn_otherwise_are_not_given_the_old_labels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = SyntheticSet(0, 1, replace(WorldConfig(), image_hw=HW))
    before = box_of(SyntheticDataset(made, cache=tmp_path))
    synthetic_source._scene.cache_clear()
    drawn = synthetic_scene
    monkeypatch.setattr(
        synthetic_source,
        "synthetic_scene",
        lambda seed, index, config: drawn(seed + 1, index, config),
    )  # as later code might
    after = box_of(SyntheticDataset(made, cache=tmp_path))
    synthetic_source._scene.cache_clear()
    assert not torch.equal(before, after)
