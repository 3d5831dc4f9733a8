import numpy as np
import pytest
from numpy.typing import NDArray

from animal3dbox.labels.axes.body_axes import trunk_axes
from animal3dbox.labels.axes.trunk_line import (
    LINES,
    TrunkLine,
    line_axes,
    line_facts,
    pitch_between,
    pitched,
)

Array = NDArray[np.float64]
PLACES: dict[str, Array] = {
    name: np.array(place)
    for name, place in {
        "tail_base": (-0.5, 0.0, 0.6),
        "neck": (0.5, 0.0, 0.7),
        "withers": (0.4, 0.0, 0.65),
        "left_shoulder_blade": (0.4, 0.1, 0.6),
        "left_shoulder_point": (0.45, 0.1, 0.4),
        "left_hip": (-0.4, 0.1, 0.5),
        "left_front_elbow": (0.35, 0.1, 0.3),
        "left_back_knee": (-0.3, 0.1, 0.35),
    }.items()
}
PLACES |= {
    name.replace("left_", "right_"): place * [1, -1, 1]
    for name, place in PLACES.items()
    if name.startswith("left_")
}


def only(*names: str) -> dict[str, Array]:
    return {
        name: place
        for name, place in PLACES.items()
        if name.removeprefix("left_").removeprefix("right_") in names
    }


@pytest.mark.parametrize(
    ("names", "line"),
    [
        (("tail_base", "shoulder_blade", "withers"), "tail_base to shoulder_blade"),
        (("tail_base", "hip", "shoulder_point", "neck"), "hip to shoulder_point"),
        (("tail_base", "shoulder_point"), "tail_base to shoulder_point"),
        (("tail_base", "withers", "front_elbow"), "tail_base to withers"),
        (
            ("tail_base", "neck", "front_elbow", "back_knee"),
            "tail_base+back_knee to neck+front_elbow",
        ),
        (("back_knee", "front_elbow"), "back_knee to front_elbow"),
    ],
)
def test_the_line_is_the_best_that_the_landmarks_allow(names: tuple[str, ...], line: str) -> None:
    axes = line_axes(only(*names))
    assert axes is not None
    assert axes.line.name == line


def test_shoulders_as_high_as_the_tails_base_give_a_level_body() -> None:
    axes = trunk_axes(only("tail_base", "shoulder_blade"))
    assert axes is not None
    assert abs(np.rad2deg(np.arctan2(axes[0][2, 0], axes[0][0, 0]))) < 2
    assert np.allclose(axes[0][:, 1], [0, 1, 0])


def test_a_shoulder_of_the_old_name_is_its_point() -> None:
    old = {name.replace("_point", ""): p for name, p in only("tail_base", "shoulder_point").items()}
    ours, theirs = trunk_axes(only("tail_base", "shoulder_point")), trunk_axes(old)
    assert ours is not None
    assert theirs is not None
    assert np.array_equal(ours[0], theirs[0])


def test_every_line_has_learned_facts() -> None:
    for line in LINES:
        assert line_facts(line).sd_within_deg < line_facts(line).sd_deg < 20


def test_a_pair_that_coincides_leaves_left_to_the_legs() -> None:
    places = only("tail_base", "withers", "front_elbow", "back_knee")
    for name in ("front_elbow", "back_knee"):
        middle = (places[f"left_{name}"] + places[f"right_{name}"]) / 2
        for side, y in (("left", 0.001), ("right", -0.001)):
            raised = 0.05 if side == "left" else 0.0
            places[f"{side}_{name}"] = middle + np.array([0.0, y, raised])
    axes = line_axes(places)
    assert axes is not None
    assert np.rad2deg(np.arccos(axes.R_box[1, 1])) < 10


def test_pitched_turns_x_towards_z_and_pitch_between_undoes_it() -> None:
    turned = pitched(np.eye(3), 30.0)
    assert np.allclose(turned[:, 0], [np.sqrt(3) / 2, 0, 0.5])
    assert pitch_between(np.eye(3), turned) == pytest.approx(30.0)


def test_a_lines_name_says_both_ends() -> None:
    assert TrunkLine(("a", "b"), ("c",)).name == "a+b to c"
