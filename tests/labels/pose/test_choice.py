"""The choice between poses: up, what the body hides, exchanged sides."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.geometry.view_sphere import orbit_rotations
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.pose.choice import MOST_UP, elevation_and_roll, exchange_cost, up_cost
from animal3dbox.labels.pose.self_occlusion import depths_in_flesh, hidden_landmarks
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.keypoints.exchanges import PARTS, exchange_order
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

AHEAD = np.array([0.0, 0.0, 5.0])
QUICK = LabelConfig(surface_share=False, mask_iou=False)
FULL_VIEW = replace(ALONE, fill=(0.6, 0.8), uav=0.0, elevation_deg=(0.0, 30.0))


def seen_from(elevation_deg: float, roll_deg: float = 0.0) -> NDArray[np.float64]:
    """R_cam_box of an animal straight ahead."""
    R = orbit_rotations(1, (elevation_deg,))[0]
    c, s = math.cos(math.radians(roll_deg)), math.sin(math.radians(roll_deg))
    rolled: NDArray[np.float64] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ R
    return rolled


def animal_with(swap: Any = "none", index: int = 0, **faults: Any) -> ForeignAnimal:
    config = ForeignConfig(
        world=FULL_VIEW, faults=FaultConfig(noise_px=1.0, swap=swap, **faults), standing=1.0
    )
    return foreign_animal(7, index, config)


def labelled(animal: ForeignAnimal, config: LabelConfig = QUICK, **changes: Any) -> CuboidLabel:
    label = label_animal(**{**animal.arguments(template=True), **changes}, config=config)
    assert isinstance(label, CuboidLabel)
    return label


def off_deg(label: CuboidLabel, animal: ForeignAnimal) -> float:
    return float(torch.rad2deg(rotation_angle(label.rotation, animal.cuboid.rotation)))


@pytest.mark.parametrize("elevation", [-60.0, -10.0, 0.0, 35.0, 80.0])
@pytest.mark.parametrize("roll", [-50.0, 0.0, 20.0])
def test_elevation_and_roll_are_those_of_the_view(elevation: float, roll: float) -> None:
    told = elevation_and_roll(seen_from(elevation, roll), AHEAD)
    assert told == pytest.approx((elevation, roll), abs=1e-6)


def test_views_from_below_and_rolled_ones_cost_more_but_never_much() -> None:
    costs = [up_cost(seen_from(e), None, AHEAD) for e in (60.0, 5.0, -5.0, -15.0, -80.0)]
    assert costs[0] == costs[1] == 0
    assert 0 < costs[2] < costs[3] < costs[4] <= MOST_UP
    assert up_cost(seen_from(10.0, 50.0), None, AHEAD) == pytest.approx(0.5, abs=0.05)
    assert up_cost(seen_from(0.0, 180.0), None, AHEAD) == MOST_UP


def test_known_gravity_decides_whatever_the_view() -> None:
    R = seen_from(-40.0)
    assert up_cost(R, -R[:, 2], AHEAD) == 0
    assert up_cost(R, R[:, 2], AHEAD) == MOST_UP
    assert up_cost(R, -R[:, 0], AHEAD) == pytest.approx((90 / 40) ** 2 / 2)


def test_a_landmark_behind_the_body_is_hidden_and_one_before_it_is_not() -> None:
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(300000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    landmarks = np.array([[0, 0, -1.0], [0, 0, 1.0], [0, 0, -0.6], [3.0, 0, 0]])
    depths = depths_in_flesh(landmarks, sphere)
    assert depths == pytest.approx([0, 0, 0.4, 2.0], abs=0.05)
    hidden = hidden_landmarks(landmarks, sphere, R=np.eye(3), t=AHEAD)
    assert hidden.tolist() == [False, True, False, False]


@pytest.mark.parametrize("part", PARTS)
def test_exchanged_sides_are_found_and_mended(part: str) -> None:
    found = 0
    for index in range(4):
        animal = animal_with(part, index)
        label = labelled(animal)
        found += label.quality.labeling == part
        if label.quality.labeling == part:
            assert off_deg(label, animal) < 10
            assert "exchanged" in label.quality.flags
            assert any("exchanged in the file" in one for one in label.quality.warnings)
            order = list(exchange_order(animal.vocabulary, part))
            assert label.keypoints is not None
            assert torch.equal(label.keypoints[:, 2], animal.keypoints_2d[order][:, 2])
    assert found >= 3


def test_right_sides_are_left_as_they_are() -> None:
    for index in range(6):
        label = labelled(animal_with("none", index, outliers=0.1))
        assert label.quality.labeling == "as given"


def test_labelings_keep_forbids_the_mending() -> None:
    animal = animal_with("all")
    label = labelled(animal, replace(QUICK, labelings="keep"))
    assert label.quality.labeling == "as given"
    assert label.keypoints is not None
    assert torch.equal(label.keypoints[:, 2], animal.keypoints_2d[:, 2])


def test_a_badly_fitting_body_needs_more_to_exchange_its_sides() -> None:
    assert exchange_cost(1.0) < exchange_cost(2.0) < exchange_cost(3.0) == exchange_cost(9.0)


@pytest.mark.parametrize("name", VOCABULARIES)
def test_an_exchange_undoes_itself_and_stays_in_its_part(name: str) -> None:
    words = VOCABULARIES[name]
    for part in PARTS:
        order = exchange_order(words, part)
        assert [order[j] for j in order] == list(range(len(words)))
    assert set(exchange_order(words, "all")) == set(range(len(words)))
    fore, hind = (exchange_order(words, part) for part in ("fore", "hind"))
    assert not {j for j, o in enumerate(fore) if o != j} & {j for j, o in enumerate(hind) if o != j}


def test_an_estimated_pose_says_how_sure_it_is_and_a_given_one_does_not() -> None:
    animal = animal_with()
    quality = labelled(animal).quality
    assert quality.rotation_sd_deg is not None
    assert 0.1 < quality.rotation_sd_deg < 10
    T = animal.camera.T_cam_world
    given = labelled(animal, pose=(T[:3, :3], T[:3, 3])).quality
    assert (given.rotation_sd_deg, given.runner_up, given.misfit) == (None, None, None)


def test_noise_makes_a_pose_less_sure() -> None:
    sds = [
        labelled(animal_with(), K=animal_with().camera.K, mask=None, keypoints_2d=k).quality
        for k in (animal_with().keypoints_2d, _without_half(animal_with().keypoints_2d))
    ]
    assert (sds[0].rotation_sd_deg or 0) < (sds[1].rotation_sd_deg or 0)


def _without_half(keypoints: torch.Tensor) -> torch.Tensor:
    fewer = keypoints.clone()
    marked = torch.nonzero(fewer[:, 2] > 0)[:, 0]
    fewer[marked[::2], 2] = 0.0
    return fewer


def test_gravity_must_be_a_unit_vector() -> None:
    with pytest.raises(SampleError, match="down_cam"):
        labelled(animal_with(), down_cam=[0.0, 9.81, 0.0])


@pytest.mark.parametrize("option", ["upright", "labelings", "focal"])
def test_options_have_their_words(option: str) -> None:
    with pytest.raises(ConfigError, match=option):
        LabelConfig(**{option: "perhaps"})  # type: ignore[arg-type]
