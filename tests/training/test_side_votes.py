"""Votes of keypoints' sides against cuboids, over the animals of an epoch."""

from collections import Counter
from typing import Any

import pytest
import torch
from scenes import training_target
from training_batches import HW

from animal3dbox.training import audit, check_targets
from animal3dbox.training.side_votes import SideVotes

SIDES = ("left", "right", None, "left", "right")
"""Of the keypoints of tests/support/scenes.py."""


def epoch(exchanged: float, *, sides: bool = True) -> list[dict[str, Any]]:
    """Targets of two animals each; the names of a part of the animals are exchanged."""
    targets = [training_target(2, HW, seed) for seed in range(60)]
    number = 0
    for target in targets:
        if sides:
            target["meta"] = {**target["meta"], "keypoint_sides": SIDES}
        keypoints = target["keypoints"].clone()
        for n in range(2):
            number += 1
            if int(number * exchanged) > int((number - 1) * exchanged):
                keypoints[n] = keypoints[n, target["keypoint_mirror"]]
        target["keypoints"] = keypoints
    return targets


def votes_of(targets: list[dict[str, Any]]) -> SideVotes:
    return check_targets(targets, [HW] * len(targets)).sides


@pytest.mark.parametrize("sides", [True, False])
def test_right_sides_are_not_warned_of(sides: bool) -> None:
    votes = votes_of(epoch(0.0, sides=sides))
    assert votes.pairs[0, 1, True] > 30
    assert votes.pairs[0, 1, False] == votes.animals[True] == 0
    assert (votes.animals[False] > 60) == sides
    assert votes.warnings == ()


def test_animals_with_exchanged_names_are_counted() -> None:
    targets = epoch(0.1)
    votes = votes_of(targets)
    assert votes.animals[True] / votes.animals.total() == pytest.approx(0.1, abs=0.05)
    assert votes.warnings[0].startswith(f"the keypoints of {votes.animals[True]} of ")
    report = audit([(torch.zeros(3, *HW), target) for target in targets])
    assert report.sides == votes
    assert f"warning: {votes.warnings[0]}" in str(report)
    assert report.faults == 0


def test_a_tenth_is_seen_of_single_pairs_where_sides_are_unknown_and_all_only_with_sides() -> None:
    assert any("keypoints 0 and 1" in text for text in votes_of(epoch(0.2, sides=False)).warnings)
    assert votes_of(epoch(1.0, sides=False)).warnings == ()
    assert len(votes_of(epoch(1.0)).warnings) == 3  # the animals, and both pairs


def test_a_pair_that_is_named_wrongly_is_named_in_the_warning() -> None:
    targets = epoch(0.0)
    for target in targets:
        target["keypoints"] = target["keypoints"][:, [0, 1, 2, 4, 3]]
    (warning,) = (text for text in votes_of(targets).warnings if text.startswith("keypoints"))
    assert warning.startswith("keypoints 3 and 4 lie the other way round")


def test_a_target_without_cuboids_or_counterparts_has_no_vote() -> None:
    targets = epoch(1.0)
    for target in targets[::2]:
        del target["keypoint_mirror"]
    for target in targets[1::2]:
        del target["size"]
    assert votes_of(targets) == SideVotes()


def test_targets_of_several_vocabularies_vote_on_their_own_pairs() -> None:
    targets = epoch(0.0)
    other = epoch(0.0)
    for target in other:
        target["keypoints"] = target["keypoints"][:, :2]
        target["keypoint_mirror"] = torch.tensor([1, 0])
        target["meta"] = {**target["meta"], "keypoint_sides": ("left", "right")}
    votes = votes_of([target for both in zip(targets, other, strict=True) for target in both])
    assert votes.pairs[0, 1, True] == 2 * votes_of(targets).pairs[0, 1, True]
    assert (votes.sides, votes.warnings) == ((), ())


def test_labels_that_mended_their_sides_are_counted() -> None:
    target = training_target(2, HW, 0)
    quality = [{"labeling": "as given"}, {"labeling": "all"}]
    target["meta"] = {**target["meta"], "quality": quality}
    report = check_targets([target], [HW])
    assert report.sides.mended == 1
    assert "1 labels exchanged left and right" in str(report)


def test_few_votes_prove_nothing() -> None:
    assert SideVotes(Counter({(0, 1, True): 20, (0, 1, False): 9})).warnings == ()
    assert len(SideVotes(Counter({(0, 1, True): 60, (0, 1, False): 27})).warnings) == 1
