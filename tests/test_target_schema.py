"""The schema of a target says each field once, and what is derived from it has its shapes."""

import pytest

from animal3dbox.target_schema import FIELDS, LABEL_FIELDS, field_of, names_of


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


def test_the_fields_of_a_label_have_fixed_shapes_and_end_with_the_flags() -> None:
    assert all(field.entry_shape is not None for field in LABEL_FIELDS)
    kinds = [field.kind for field in LABEL_FIELDS]
    assert kinds == sorted(kinds, key=lambda kind: kind == "flag")
    assert set(kinds) == {"float", "flag"}


def test_names_are_chosen_by_what_they_are() -> None:
    assert names_of(per="either") == ("R", "t")
    assert "distance" in names_of(per="animal", under_map="unmoved")
    assert set(names_of(kind="flag")) <= {field.name for field in FIELDS if field.dtype == "bool"}
