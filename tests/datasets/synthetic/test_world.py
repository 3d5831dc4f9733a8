"""The synthetic world.

Its renderer against rays, its truth, its ranges, and that it repeats itself.
"""

import hashlib
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from rays import nearest_triangles
from scipy.spatial.transform import Rotation

from animal3dbox.datasets.synthetic.scenes import SyntheticScene, synthetic_scene
from animal3dbox.datasets.synthetic.world.coats import (
    KINDS,
    coat_colors,
    draw_coat,
    template_features,
)
from animal3dbox.datasets.synthetic.world.config import CLEAR, WorldConfig, world_generator
from animal3dbox.datasets.synthetic.world.scene import ScenePlan, plan_scene
from animal3dbox.datasets.synthetic.world.shading import Light, Surface, render
from animal3dbox.datasets.synthetic.world.things import OCCLUDERS, REACH, make_ledge, make_thing
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.camera import PinholeCamera, intrinsics, look_at, project
from animal3dbox.geometry.rigid_transforms import transform_points
from animal3dbox.geometry.visible_surface import visible_vertices
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

SMALL = WorldConfig(image_hw=(96, 128), focal_px=(100.0, 1000.0))
CROWDED = replace(SMALL, occluded=1.0, animals=(2, 3), fill=(0.4, 0.9), uav=0.2)
F64 = torch.float64


@pytest.fixture(scope="module")
def crowded() -> list[SyntheticScene]:
    """Scenes with several animals and occluders."""
    return [synthetic_scene(11, index, CROWDED) for index in range(6)]


@pytest.fixture(scope="module")
def plans() -> list[ScenePlan]:
    """Scenes as they come, before they are rendered."""
    return [plan_scene(4, index, WorldConfig()) for index in range(40)]


# Against rays
# --------------------------------------------------------------------------------------------------


def test_the_picture_shows_what_rays_meet_first(crowded: list[SyntheticScene]) -> None:
    both = either = same = rays_hit = 0
    for scene in crowded[:3]:
        v, u = np.mgrid[1:96:4, 1:128:4].reshape(2, -1)
        directions = (
            np.stack((u, v, np.ones_like(u)), axis=1) @ torch.linalg.inv(scene.camera.K).numpy().T
        )
        mesh, count = scene.animals[0].scene, len(scene.plan.animals)
        triangle, _ = nearest_triangles(mesh.vertices_cam.numpy(), mesh.faces.numpy(), directions)
        number = np.where(triangle >= 0, triangle // len(load_quadruped().faces), -1)
        ours = scene.owner.numpy()[v, u]
        for animal in range(count):
            both += int(((number == animal) & (ours == animal)).sum())
            either += int(((number == animal) | (ours == animal)).sum())
        same += int(((number >= 0) == (ours >= 0)).sum())
        rays_hit += len(number)
    assert either > 200
    assert both / either >= 0.99
    assert same / rays_hit >= 0.999


def test_keypoints_are_visible_where_no_ray_to_them_is_blocked(
    crowded: list[SyntheticScene],
) -> None:
    agree, hidden_by_others = [], 0
    for scene in crowded[:3]:
        for animal in scene.animals:
            vertices, faces = animal.scene.vertices_cam.numpy(), animal.scene.faces.numpy()
            start = animal.number * animal.model.vertex_count
            own = faces[
                (faces >= start).all(1) & (faces < start + animal.model.vertex_count).all(1)
            ]
            places = animal.vocabulary.places(
                animal.model.landmark_groups, animal.model.vertex_count
            )
            of = np.array(
                [
                    (keypoint, start + int(i))
                    for keypoint, place in enumerate(places)
                    for i in (place if place is not None else ())
                ]
            )
            targets = vertices[of[:, 1]]
            free, free_of_itself = (
                nearest_triangles(vertices, some, targets)[1] > 1 - 1e-6 for some in (faces, own)
            )
            px = project(animal.K, torch.from_numpy(targets))[0].numpy()
            inside = ((px >= -0.5) & (px <= [127.5, 95.5])).all(1)
            for keypoint in range(len(places)):
                mine, in_frame = of[:, 0] == keypoint, bool(animal.keypoints_2d[keypoint, 2] > 0)
                expected = in_frame and bool((free & inside & mine).any())
                hidden_by_others += (
                    in_frame and not expected and bool((free_of_itself & inside & mine).any())
                )
                agree.append(bool(animal.keypoint_visible[keypoint]) == expected)
    assert len(agree) > 100
    assert np.mean(agree) >= 0.99
    assert hidden_by_others > 5  # or the test would not see whether occluders count


def test_masks_are_parts_of_the_silhouettes_and_do_not_overlap(
    crowded: list[SyntheticScene],
) -> None:
    cut = 0
    for scene in crowded:
        total = torch.zeros(96, 128, dtype=torch.int64)
        for animal in scene.animals:
            assert bool((animal.mask & ~animal.amodal_mask).sum() == 0)
            assert animal.visible_part == int(animal.mask.sum()) / int(animal.amodal_mask.sum())
            cut += animal.visible_part < 0.95
            total += animal.mask
        assert int(total.max()) == 1
        assert scene.animals[0].visible_part > 0.3
    assert cut >= 2


# The same again
# --------------------------------------------------------------------------------------------------


def test_a_scene_depends_on_its_seed_and_index_alone() -> None:
    first = synthetic_scene(3, 5, SMALL)
    synthetic_scene(3, 4, SMALL)
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002  # a global seed must change nothing
    again = synthetic_scene(3, 5, SMALL)
    assert torch.equal(first.image, again.image)
    assert torch.equal(first.animals[0].vertices, again.animals[0].vertices)
    assert not torch.equal(first.image, synthetic_scene(3, 6, SMALL).image)
    assert not torch.equal(first.image, synthetic_scene(4, 5, SMALL).image)


def test_another_process_draws_the_same_scene() -> None:
    code = (
        "import hashlib; from animal3dbox.datasets.synthetic.scenes import synthetic_scene;from"
        " animal3dbox.datasets.synthetic.world.config import"
        " WorldConfig;print(hashlib.sha256(synthetic_scene(3, 5, WorldConfig(image_hw=(96, 128),"
        " focal_px=(100.0, 1000.0))).image.numpy().tobytes()).hexdigest())"
    )
    theirs = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()
    assert (
        theirs == hashlib.sha256(synthetic_scene(3, 5, SMALL).image.numpy().tobytes()).hexdigest()
    )


def test_seeds_and_indices_are_not_mixed_up_and_cannot_be_negative() -> None:
    drawn = {
        float(world_generator(seed, index, part).random())
        for seed in range(3)
        for index in range(3)
        for part in ("a", "b")
    }
    assert len(drawn) == 18
    with pytest.raises(ConfigError, match="must not be negative"):
        synthetic_scene(-1, 0, SMALL)


# What is drawn
# --------------------------------------------------------------------------------------------------


def roll_deg(camera: PinholeCamera, target: torch.Tensor) -> float:
    """How far the vertical through a point is turned in the picture of a camera that points
    straight at it."""
    R, t = camera.T_cam_world[:3, :3].numpy(), camera.T_cam_world[:3, 3].numpy()
    ahead = R @ target.numpy() + t
    ahead /= np.linalg.norm(ahead)
    axis = np.cross([0.0, 0.0, 1.0], ahead)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.arccos(ahead[2])).as_matrix()
    up = turn.T @ R @ [0.0, 0.0, 1.0]
    return float(np.degrees(np.arctan2(up[0], -up[1])))


def test_cameras_keep_to_their_ranges_and_use_them(plans: list[ScenePlan]) -> None:
    config = WorldConfig()
    elevations, fills, rolls, cut = [], [], [], 0
    for plan in plans:
        K, eye, body = plan.camera.K, plan.camera.center_world, plan.animals[0].vertices
        away = eye - (body.amax(0) + body.amin(0)) / 2
        elevations.append(float(torch.rad2deg(torch.atan2(away[2], away[:2].norm()))))
        assert 500 <= float(K[0, 0]) <= 5000
        assert float(K[0, 0]) == float(K[1, 1])
        assert abs(float(K[0, 2]) - 319.5) <= 0.12 * 640
        assert abs(float(K[1, 2]) - 239.5) <= 0.12 * 480
        rolls.append(roll_deg(plan.camera, (body.amax(0) + body.amin(0)) / 2))
        px, depth = plan.camera.project(body)
        assert float(depth.amin()) > 0.09
        size = (px.amax(0) - px.amin(0)) / torch.tensor([640.0, 480.0])
        fills.append(float(size.amax()))
        low, high = px.amin(0), px.amax(0)
        cut += bool((low < -0.5).any() or (high > torch.tensor([639.5, 479.5])).any())
    assert min(elevations) >= config.elevation_deg[0] - 0.1
    assert max(elevations) <= config.elevation_deg[1] + 0.1
    assert min(elevations) < 2
    assert max(elevations) > 55
    assert max(rolls) <= config.roll_deg + 1e-6
    assert min(rolls) >= -config.roll_deg - 1e-6
    assert max(rolls) > 8
    assert min(rolls) < -8
    assert min(fills) >= 0.08 * 0.97
    assert max(fills) <= 0.95 * 1.03
    assert min(fills) < 0.25
    assert max(fills) > 0.75
    assert 1 <= cut <= 15


def test_animals_stand_on_the_ground_and_apart(plans: list[ScenePlan]) -> None:
    counts = set()
    for plan in plans:
        counts.add(len(plan.animals))
        for i, animal in enumerate(plan.animals):
            assert abs(float(animal.vertices[:, 2].amin())) < 1e-9
            assert len({a.preset for a in plan.animals}) == 1
            for other in plan.animals[:i]:
                assert float((animal.place - other.place).norm()) > animal.reach + other.reach
    assert {1, 2, 3} <= counts


def test_presets_come_in_turn_and_every_pose_comes(plans: list[ScenePlan]) -> None:
    assert [plan.animals[0].preset for plan in plans[:10]] == [
        plan.animals[0].preset for plan in plans[10:20]
    ]
    assert len({plan.animals[0].preset for plan in plans[:10]}) == 10
    assert len({animal.pose_name for plan in plans for animal in plan.animals}) >= 9
    one, other = plans[0].animals[0], plans[10].animals[0]
    assert not torch.equal(one.betas, other.betas)  # individuals, not copies


def test_a_camera_from_below_looks_up_at_an_animal_on_a_ledge() -> None:
    low = replace(SMALL, elevation_deg=(-10.0, -9.0), uav=0.0, fill=(0.4, 0.6), truncated=0.0)
    for index in range(3):
        scene = synthetic_scene(2, index, low)
        assert [thing.kind for thing in scene.plan.things] == ["ledge"]
        assert scene.plan.ground_z < float(scene.camera.center_world[2])
        assert float(scene.plan.things[0].vertices[:, 2].amax()) < 0
        assert scene.animals[0].visible_part > 0.6  # the rim hides no more than the feet


@pytest.mark.parametrize("kind", [*OCCLUDERS, "tree", "ledge"])
def test_things_are_closed_point_outwards_and_keep_within_their_reach(kind: str) -> None:
    rng, place = np.random.default_rng(0), np.array([2.0, -1.0])
    thing = (
        make_ledge(rng, place, 0.5, -1.0, color=(0.5, 0.5, 0.5))
        if kind == "ledge"
        else make_thing(rng, kind, place)
    )
    a, b, c = thing.vertices[thing.faces].unbind(1)
    vector_area = torch.linalg.cross(b - a, c - a).sum(0)
    assert float(vector_area.abs().amax()) < 1e-9  # of a closed surface it vanishes
    assert float((torch.linalg.cross(a, b) * c).sum()) > 0  # and the volume is positive
    if kind in OCCLUDERS:
        reach = float((thing.vertices[:, :2] - torch.from_numpy(place)).norm(dim=1).amax())
        assert reach <= REACH[kind] + 1e-9


def test_a_coat_sticks_to_the_body_in_every_pose() -> None:
    model, coat = load_quadruped(), draw_coat(np.random.default_rng(3), "zebra")
    K, hw = intrinsics(700.0, (240, 320)), (240, 320)
    T = look_at(
        *(torch.tensor(v, dtype=F64) for v in ([0.3, 3.0, 0.6], [0.0, 0.0, 0.4], [0.0, 0.0, 1.0]))
    )
    shown = []
    for pose in ("stand", "run"):
        body = model.posed(
            preset_betas("zebra")[None], named_pose(pose)[None], torch.zeros(1, 3, dtype=F64)
        ).vertices[0]
        surface = Surface(
            body, model.faces, template_features(), lambda features: coat_colors(coat, features)
        )
        made = render(
            [surface], PinholeCamera(K, T, hw), np.zeros((*hw, 3), np.float32), Light(sunny=0.0)
        )
        px, _ = project(K, transform_points(T, body))
        column, row = px.round().long().unbind(1)
        seen = visible_vertices(transform_points(T, body), model.faces, K, hw)
        shown.append(
            (seen, made.image[row.clamp(0, 239), column.clamp(0, 319)].double().mean(1), column)
        )
    both = shown[0][0] & shown[1][0]
    moved = both & ((shown[0][2] - shown[1][2]).abs() > 8)
    a, b = shown[0][1][moved], shown[1][1][moved]
    assert int(moved.sum()) > 100
    assert (
        float(torch.corrcoef(torch.stack((a, b)))[0, 1]) > 0.8
    )  # stripes have moved with the skin; pixels and shade differ a little


def test_coats_are_colours_and_differ_by_kind() -> None:
    features = template_features()
    rng = np.random.default_rng(0)
    seen = {}
    for _ in range(200):
        coat = draw_coat(rng, "dog")
        seen[coat.kind] = coat_colors(coat, features)
    assert set(seen) == set(KINDS)
    for kind, colors in seen.items():
        assert colors.min() >= 0, kind
        assert colors.max() < 1.2, kind
    belly, back = features[:, 3] < -0.8, features[:, 3] > 0.8
    shaded = seen["countershading"].mean(1)
    assert shaded[belly].mean() > shaded[back].mean()


IMPOSSIBLE = [
    ("presets", ("unicorn",)),
    ("poses", ("dance",)),
    ("fill", (0.5, 1.5)),
    ("occluded", -0.1),
    ("animals", (3, 2)),
    ("focal_px", (0.0, 9.0)),
]


@pytest.mark.parametrize(("field", "value"), IMPOSSIBLE)
def test_an_impossible_world_is_refused_by_the_name_of_its_field(field: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"^{field} must"):
        replace(CLEAR, **{field: value})  # type: ignore[arg-type]


def test_no_animal_stands_on_its_tail() -> None:
    model = load_quadruped()
    is_tail = torch.zeros(model.vertex_count, dtype=torch.bool)
    is_tail[model.tail_vertices] = True
    config = replace(
        SMALL, poses=("lie", "sit", "curl"), animals=(1, 1), pose_spread=0.0, shape_spread=0.0
    )
    for index in range(20):
        z = plan_scene(1, index, config).animals[0].vertices[:, 2]
        assert float(z[~is_tail].amin()) < 0.01
