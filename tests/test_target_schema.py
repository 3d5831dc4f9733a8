"""The schema of a target says each field once, and what is derived from it has its shapes."""

from pathlib import Path
from typing import Any

import pytest
import torch

from animal3dbox.datasets import KnownScale, LabelDataset, SyntheticDataset, SyntheticSet
from animal3dbox.target_schema import (
    FIELDS,
    LABEL_FIELDS,
    META_PER_ANIMAL,
    META_PER_IMAGE,
    field_of,
    names_of,
    target_table,
)


def used(dataset: LabelDataset) -> Any:
    return dataset[0]


def test_every_field_is_said_once() -> None:
    names = [field.name for field in FIELDS]
    assert len(names) == len(set(names))
    in_labels = [field.label_name for field in LABEL_FIELDS]
    assert len(in_labels) == len(set(in_labels))


def test_shapes_are_read_axis_by_axis() -> None:
    corners = field_of("corners_3d")
    assert (corners.entry_shape, corners.width, corners.spec) == ((8, 3), 24, "N 8 3")
    assert (field_of("truncation").entry_shape, field_of("truncation").spec) == ((), "N")
    assert (field_of("K").spec, field_of("keypoints").entry_shape) == ("3 3", None)
    with pytest.raises(ValueError, match="keypoints has no fixed shape: J 3"):
        _ = field_of("keypoints").width


def test_the_fields_of_a_label_have_fixed_shapes_and_end_with_whole_numbers_and_flags() -> None:
    assert all(field.entry_shape is not None for field in LABEL_FIELDS)
    kinds = [field.kind for field in LABEL_FIELDS]
    assert kinds == sorted(kinds, key=("float", "whole", "flag").index)
    assert set(kinds) == {"float", "whole", "flag"}


def test_names_are_chosen_by_what_they_are() -> None:
    assert names_of(per="either") == ("R", "t")
    assert "distance" in names_of(per="animal", under_map="unmoved")
    assert set(names_of(kind="flag")) <= {field.name for field in FIELDS if field.dtype == "bool"}


def test_the_docs_show_the_table_that_the_schema_gives() -> None:
    page = (Path(__file__).parent.parent / "docs" / "datasets.md").read_text()
    assert target_table() in page


def test_a_dataset_gives_the_fields_of_the_schema_in_its_shapes_and_types() -> None:
    _, target = used(SyntheticDataset(SyntheticSet(seed=0, images=1)))
    animals = len(target["labels"])
    assert set(target["meta"]) == {*META_PER_ANIMAL, *META_PER_IMAGE}
    fields = {field.name: field for field in FIELDS if field.made_by == "dataset"}
    assert set(target) - {"image_id", "meta"} == set(fields) - {"surface_share", "distortion"}
    for name in set(target) - {"image_id", "meta"}:
        field, value = fields[name], target[name]
        assert str(value.dtype) == f"torch.{field.dtype}", name
        assert value.ndim == len(field.shape.split()) + (field.per != "image"), name
        if field.entry_shape is not None:
            counted = () if field.per == "image" else (animals,)
            assert tuple(value.shape) == (*counted, *field.entry_shape), name


def test_the_distance_is_that_of_the_boxs_centre_and_grows_with_its_unit() -> None:
    made = SyntheticSet(seed=0, images=1)
    _, plain = used(SyntheticDataset(made))
    _, metric = used(SyntheticDataset(made, scale=KnownScale(2.0)))
    torch.testing.assert_close(plain["distance"], plain["center"].norm(dim=-1))
    torch.testing.assert_close(metric["distance"], 2 * plain["distance"])
