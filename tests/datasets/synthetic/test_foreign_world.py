"""The foreign world: exact truth, bodies beyond the presets, keypoints and masks of others."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.animals import foreign_animal
from animal3dbox.datasets.synthetic.foreign.bodies import (
    PART_SPREAD,
    merged_mesh,
    stretched_model,
)
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.datasets.synthetic.foreign.masks import worn_mask
from animal3dbox.datasets.synthetic.foreign.mirrored import mirrored_animal
from animal3dbox.datasets.synthetic.foreign.parts import model_of_parts
from animal3dbox.datasets.synthetic.foreign.places import drawn_offsets, trunk_length
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.axes.body_axes import torso_axes
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

SMALL = replace(ALONE, image_hw=(120, 160))
EXACT = ForeignConfig(
    world=SMALL, faults=FaultConfig(), places=0.0, places_of_animal=0.0, mask_jitter_px=0.0
)
SAME = dict.fromkeys(PART_SPREAD, 1.0)


def test_a_seed_and_an_index_give_the_same_animal() -> None:
    """Whatever was drawn before."""
    first = foreign_animal(0, 3, ForeignConfig(world=SMALL))
    foreign_animal(1, 1, ForeignConfig(world=SMALL))
    second = foreign_animal(0, 3, ForeignConfig(world=SMALL))
    assert torch.equal(first.vertices, second.vertices)
    assert torch.equal(first.keypoints_2d, second.keypoints_2d)
    assert torch.equal(first.mask, second.mask)


def test_factors_of_one_leave_a_species_as_it_is() -> None:
    """And others stretch the legs alone."""
    model, betas = load_quadruped(), preset_betas("dog")
    plain = stretched_model(model, betas, SAME)
    torch.testing.assert_close(plain.v_template, model.shaped(betas[None])[0])
    long_legs = stretched_model(model, betas, {**SAME, "leg_length": 1.5})
    shoulder, paw = (
        list(model.landmark_groups[f"left_{n}"]) for n in ("shoulder_point", "front_paw")
    )
    height = [
        float(m.v_template[shoulder, 2].mean() - m.v_template[paw, 2].mean())
        for m in (plain, long_legs)
    ]
    assert 1.4 < height[1] / height[0] < 1.55
    assert trunk_length(long_legs) == pytest.approx(trunk_length(plain), rel=0.01)


def test_the_trunk_is_that_of_the_torsos_vertices() -> None:
    """The truth is the spine's; the torso of a standing body agrees, whatever its proportions."""
    config = replace(EXACT, standing=1.0)
    for index in range(4):
        animal = foreign_animal(5, index, config)
        R = torso_axes(animal.vertices.numpy(), animal.model)
        angle = np.degrees(np.arccos(min(1.0, (np.trace(R.T @ animal.trunk.numpy()) - 1) / 2)))
        assert angle < 6, animal.sample_id


def test_places_move_together_in_a_dataset_and_by_mirrored_pairs() -> None:
    """The same for every animal of a dataset, and another for another."""
    words = VOCABULARIES["animal3d26"]
    offsets = drawn_offsets(np.random.default_rng(0), words)
    mirrored = offsets[list(words.flip)] * torch.tensor([1.0, -1.0, 1.0])
    assert torch.equal(offsets, mirrored)
    assert 0.6 < float(offsets.std()) < 1.4
    config = replace(EXACT, places=0.08, standing=1.0, proportions=0.0)
    one, other, apart = (
        foreign_animal(0, index, config, dataset=number)
        for index, number in ((0, 7), (9, 7), (0, 8))
    )
    chin = words.index_of("chin") or 0
    offset = [
        (a.landmarks[chin] - words.on_body(a.model.landmark_groups, a.vertices)[chin]).norm()
        / trunk_length(a.model)
        for a in (one, other, apart)
    ]
    assert float(abs(offset[0] - offset[1])) < 0.01 < float(abs(offset[0] - offset[2]))


def test_level_shoulders_lie_at_the_height_of_the_tail() -> None:
    """As SMAL's keypoint groups do."""
    animal = foreign_animal(0, 0, replace(EXACT, shoulders="level", standing=1.0))
    words = animal.vocabulary
    places = [animal.landmarks[words.index_of(n) or 0] for n in ("tail_base", "left_shoulder")]
    forward, up = animal.trunk[:, 0], animal.trunk[:, 2]
    ahead = places[1] - places[0]
    assert abs(float(torch.atan2(ahead @ up, ahead @ forward))) < np.radians(8)


def test_the_mask_is_the_silhouette_of_another_renderer() -> None:
    """Within the border, and the jitter moves it by about its sigma."""
    animal = foreign_animal(2, 1, replace(EXACT, world=replace(ALONE, fill=(0.6, 0.8))))
    T = animal.camera.T_cam_world
    vertices_cam = animal.vertices @ T[:3, :3].mT + T[:3, 3]
    drawn = silhouette(vertices_cam, animal.model.faces, animal.camera.K, animal.camera.image_hw)
    assert float((drawn & animal.mask).sum() / (drawn | animal.mask).sum()) > 0.95
    worn = worn_mask(animal.mask.numpy(), np.random.default_rng(0), jitter_px=1.0, holes=False)
    outline = 4 * float(animal.mask.sum()) ** 0.5
    assert 0.1 * outline < int((worn ^ animal.mask).sum()) < 3 * outline
    holed = worn_mask(animal.mask.numpy(), np.random.default_rng(0), jitter_px=0.0, holes=True)
    assert not bool((holed & ~animal.mask).any())
    assert int(holed.sum()) < int(animal.mask.sum())


def test_the_fitted_body_is_off_by_its_dials_alone() -> None:
    """Without them it is the animal's own."""
    animal = foreign_animal(0, 1, EXACT)
    torch.testing.assert_close(animal.fitted[0], animal.vertices)
    torch.testing.assert_close(animal.fitted[1], animal.landmarks, equal_nan=True)
    off = foreign_animal(0, 1, replace(EXACT, faults=FaultConfig(joint_deg=5), stature=0.05))
    assert torch.equal(off.vertices, animal.vertices)
    assert 0.005 < float((off.fitted[0] - animal.vertices).norm(dim=1).mean()) < 0.2


def test_another_mesh_has_fewer_vertices_and_the_same_extent() -> None:
    """Cells of 3 % of the body."""
    animal = foreign_animal(0, 2, EXACT)
    vertices, faces = merged_mesh(animal.vertices, animal.model.faces, 0.03)
    assert len(vertices) < len(animal.vertices) / 2
    assert int(faces.max()) == len(vertices) - 1
    extents = [v.amax(0) - v.amin(0) for v in (vertices, animal.vertices)]
    assert float((extents[0] - extents[1]).abs().max()) < 0.06


def test_animals_lie_on_their_sides_and_cameras_look_up_when_asked() -> None:
    """Both are outside of what the world's scenes have."""
    lying = foreign_animal(0, 0, replace(EXACT, lying=1.0))
    assert lying.pose.startswith("side ")
    assert abs(float(lying.trunk[2, 2])) < 0.5
    below = replace(SMALL, uav=0.0, elevation_deg=(-40.0, -10.0))
    animal = foreign_animal(0, 0, replace(EXACT, world=below))
    assert float(animal.camera.center_world[2]) < 0.4


def test_a_mirrored_animal_is_an_animal_before_a_camera() -> None:
    """Its picture is the mirrored one, keypoints are named by its own sides, and so is its body."""
    animal = foreign_animal(3, 4, replace(EXACT, places=0.08))
    mirrored = mirrored_animal(animal)
    width = animal.camera.image_hw[1]
    left, right = (animal.vocabulary.index_of(f"{side}_eye") or 0 for side in ("left", "right"))
    px, _ = mirrored.camera.project(mirrored.landmarks)
    original, _ = animal.camera.project(animal.landmarks)
    assert px[left, 0] == pytest.approx(float(width - 1 - original[right, 0]))
    torch.testing.assert_close(torch.linalg.det(mirrored.trunk), torch.tensor(1.0).double())
    torch.testing.assert_close(
        torch.linalg.det(mirrored.camera.R_cam_world), torch.tensor(1.0).double()
    )
    # The mirrored body lies in the mirrored mask, and is in correspondence with its model.
    T = mirrored.camera.T_cam_world
    vertices_cam = mirrored.vertices @ T[:3, :3].mT + T[:3, 3]
    drawn = silhouette(
        vertices_cam, mirrored.model.faces, mirrored.camera.K, mirrored.camera.image_hw
    )
    assert float((drawn & mirrored.mask).sum() / (drawn | mirrored.mask).sum()) > 0.9
    R = torso_axes(mirrored.vertices.numpy(), mirrored.model)
    torch.testing.assert_close(torch.from_numpy(R), mirrored.trunk, atol=0.2, rtol=0)


@pytest.mark.parametrize(
    "dial", [{"places": 0.6}, {"shoulders": "low"}, {"standing": 2}, {"poses": ("fly",)}]
)
def test_dials_have_limits(dial: dict[str, object]) -> None:
    """The error names the dial."""
    with pytest.raises(ConfigError, match=next(iter(dial))):
        ForeignConfig(**dial)  # type: ignore[arg-type]


def test_a_body_of_parts_has_the_skeleton_and_none_of_the_surface() -> None:
    model = load_quadruped()
    other = model_of_parts(model, np.random.default_rng(0))
    torch.testing.assert_close(
        other.J_regressor @ other.v_template, model.J_regressor @ model.v_template
    )
    nearest = torch.cdist(other.v_template, model.v_template).amin(1)
    assert float((nearest < 1e-6).double().mean()) < 0.01
    for j in range(other.joint_count):
        corners = other.v_template[other.faces[other.weights[other.faces[:, 0], j] == 1]]
        volume = torch.linalg.det(corners).sum() / 6
        assert volume > 0, "a part is closed, and its faces look outwards"
    for name, group in model.landmark_groups.items():
        if not name.startswith("joint:"):
            moved = other.v_template[list(other.landmark_groups[name])].mean(0)
            place = model.v_template[list(group)].mean(0)
            assert torch.linalg.vector_norm(moved - place) < 0.15 * trunk_length(model), name


def test_a_thing_before_the_animal_cuts_the_mask_and_hides_keypoints() -> None:
    whole = [foreign_animal(0, i, EXACT) for i in range(4)]
    cut = [foreign_animal(0, i, replace(EXACT, occluded=1.0)) for i in range(4)]
    for before, after in zip(whole, cut, strict=True):
        lost = before.mask & ~after.mask
        assert bool(lost.any())
        assert not bool((after.mask & ~before.mask).any())
        x, y, marked = before.exact.round().long().T
        marked = before.keypoints_2d[:, 2] > 0
        inside = (x < 160) & (y < 120) & (x >= 0) & (y >= 0)
        behind = marked & inside & lost[y.clamp(0, 119), x.clamp(0, 159)]
        assert not bool((after.keypoints_2d[behind, 2] > 0).any())
    assert sum(int((a.keypoints_2d[:, 2] > 0).sum()) for a in cut) < sum(
        int((a.keypoints_2d[:, 2] > 0).sum()) for a in whole
    )


def test_noise_by_extent_grows_with_the_animal() -> None:
    noisy = replace(EXACT, faults=FaultConfig(noise_extent=0.02))
    parts = []
    for i in range(12):
        animal = foreign_animal(0, i, noisy)
        marked = animal.keypoints_2d[:, 2] > 0
        exact = animal.exact[marked, :2]
        extent = (exact.amax(0) - exact.amin(0)).max()
        parts.append((animal.keypoints_2d[marked, :2] - exact) / extent)
    assert float(torch.cat(parts).std()) == pytest.approx(0.02, rel=0.15)


def test_animals_of_a_class_are_alike_and_other_datasets_have_other_classes() -> None:
    config = replace(EXACT, individual=0.0)

    def template(index: int, dataset: int) -> torch.Tensor:
        return foreign_animal(1, index, config, dataset=dataset).model.v_template

    again = 10  # presets, taken in turn
    assert torch.equal(template(0, 0), template(again, 0))
    assert not torch.equal(template(0, 0), template(0, 1))
    assert not torch.equal(template(0, 0), template(1, 0))
    varied = replace(config, individual=0.3)
    own = foreign_animal(1, again, varied, dataset=0).model.v_template
    apart = float((own - template(0, 0)).norm(dim=1).mean())
    others = foreign_animal(1, again, replace(config, individual=1.0), dataset=0).model.v_template
    assert 0 < apart < float((others - template(0, 0)).norm(dim=1).mean())
