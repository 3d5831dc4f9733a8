"""The plan of a scene: its animals, things and camera, everything but the pixels."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets.synthetic.world.animals import StandingAnimal, draw_animal
from animal3dbox.datasets.synthetic.world.cameras import draw_camera
from animal3dbox.datasets.synthetic.world.coats import Coat, draw_coat
from animal3dbox.datasets.synthetic.world.config import WorldConfig, world_generator
from animal3dbox.datasets.synthetic.world.ground import Setting, draw_setting
from animal3dbox.datasets.synthetic.world.things import (
    LEDGE_GAP,
    OCCLUDERS,
    REACH,
    Thing,
    make_ledge,
    make_thing,
)
from animal3dbox.geometry.camera import PinholeCamera
from animal3dbox.geometry.rasterizer import rasterize, silhouette
from animal3dbox.geometry.rigid_transforms import transform_points
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names

Place = NDArray[np.float64]
"""A place (2,) on the ground."""

GROUND_LEVEL_EYE = 0.15
"""A camera lower than this over the feet looks up at an animal on a ledge."""
LEDGE_DROP = 0.5
"""Height of a ledge over the ground, at least, in body lengths."""
GAP = 0.04
"""Least distance of the circles that animals and things keep within."""
TRIES = 8
"""Number of places that are tried for a further animal."""
CLEAR_DEPTH = 0.3
"""Nothing but the animal itself comes nearer to the camera, in body lengths."""
LEAST_SEEN = 0.4
"""Part of the first animal that nothing hides, at least."""
COARSE = 4
"""Side in pixels of the coarse ones by which the hidden part is measured."""
HIDING = ((0.26, OCCLUDERS), (0.6, ("trunk", "fence", "bush", "tree")), (np.inf, ("tree",)))
"""Kinds of things that can hide an animal from a camera, up to a sine of its elevation."""
EXTRAS = 0.5
"""Part of the images with further things anywhere."""


@dataclass(frozen=True)
class ScenePlan:
    """One scene before it is rendered.

    Attributes:
        seed: of the world.
        index: of the scene.
        camera: in the world, z up.
        animals: the animals, of which the camera is aimed at the first.
        coats: one an animal.
        things: the things beside and before the animals.
        setting: ground, sky and light.
        ground_z: height of the ground; 0 unless the animal stands on a ledge.
    """

    seed: int
    index: int
    camera: PinholeCamera
    animals: tuple[StandingAnimal, ...]
    coats: tuple[Coat, ...]
    things: tuple[Thing, ...]
    setting: Setting
    ground_z: float


def plan_scene(seed: int, index: int, config: WorldConfig) -> ScenePlan:
    """The plan of a scene by a seed and an index; no other scene has any influence on it."""
    rngs = {
        part: world_generator(seed, index, part)
        for part in ("animal", "camera", "herd", "things", "coats", "setting")
    }
    presets = config.presets or quadruped_names().presets
    preset = presets[index % len(presets)]
    first = draw_animal(rngs["animal"], preset, config)
    camera = draw_camera(rngs["camera"], first.vertices, config)
    setting = draw_setting(rngs["setting"])
    eye_z = float(camera.center_world[2])
    animals: tuple[StandingAnimal, ...] = (first,)
    things: tuple[Thing, ...]
    if eye_z < GROUND_LEVEL_EYE:
        ground_z = min(eye_z, 0.0) - LEDGE_DROP
        things = (_ledge_under(rngs["things"], first, ground_z, setting),)
    else:
        animals, ground_z = _herd(rngs["herd"], first, camera, config), 0.0
        things = _things(rngs["things"], animals, camera, config)
        animals, things = _with_first_visible(animals, things, camera)
    return ScenePlan(
        seed=seed,
        index=index,
        camera=camera,
        animals=animals,
        coats=tuple(draw_coat(rngs["coats"], animal.preset) for animal in animals),
        things=things,
        setting=setting,
        ground_z=ground_z,
    )


def _herd(
    rng: np.random.Generator, first: StandingAnimal, camera: PinholeCamera, config: WorldConfig
) -> tuple[StandingAnimal, ...]:
    """The first animal, and others of its species beside it that the camera sees, too."""
    count = int(rng.integers(config.animals[0], config.animals[1] + 1))
    if config.animals[0] == 1 and rng.random() < 0.5:
        count = 1  # most photographs show one
    animals = [first]
    for _ in range(count - 1):
        other = draw_animal(rng, first.preset, config)
        for _ in range(TRIES):
            neighbour = animals[int(rng.integers(len(animals)))]
            angle = rng.uniform(-np.pi, np.pi)
            distance = neighbour.reach + other.reach + GAP + rng.exponential(0.5)
            direction = torch.tensor([np.cos(angle), np.sin(angle)], dtype=torch.float64)
            candidate = other.moved(neighbour.place + distance * direction)
            is_apart = all(_apart(candidate, animal) for animal in animals)
            if is_apart and _well_visible(candidate.vertices, camera):
                animals.append(candidate)
                break
    return tuple(animals)


def _apart(a: StandingAnimal, b: StandingAnimal) -> bool:
    """Whether the circles that two animals keep within have a gap between them."""
    return float(torch.linalg.vector_norm(a.place - b.place)) > a.reach + b.reach + GAP


def _well_visible(vertices: Tensor, camera: PinholeCamera) -> bool:
    """Whether a body is clear of the camera, its middle in the frame, and not larger than it."""
    px, depth = camera.project(vertices)
    if float(depth.amin()) < CLEAR_DEPTH:
        return False
    height, width = camera.image_hw
    frame = torch.tensor([width, height], dtype=torch.float64)
    middle, size = (px.amax(0) + px.amin(0)) / 2, px.amax(0) - px.amin(0)
    return bool(((middle > 0) & (middle < frame) & (size < 1.2 * frame)).all())


def _ledge_under(
    rng: np.random.Generator, animal: StandingAnimal, bottom: float, setting: Setting
) -> Thing:
    """The ledge that an animal stands on, no wider than its feet need."""
    feet = animal.vertices[animal.vertices[:, 2] < 0.1, :2]
    place = (feet.amax(0) + feet.amin(0)) / 2
    reach = float(torch.linalg.vector_norm(feet - place, dim=1).amax()) + 0.03
    r, g, b = (0.45 * (low + high) for low, high in zip(setting.low, setting.high, strict=True))
    return make_ledge(rng, place.numpy(), reach, bottom + LEDGE_GAP, color=(r, g, b))


def _with_first_visible(
    animals: tuple[StandingAnimal, ...], things: tuple[Thing, ...], camera: PinholeCamera
) -> tuple[tuple[StandingAnimal, ...], tuple[Thing, ...]]:
    """The animals and things without so many that the first animal is visible enough.

    Things are taken away first, then the other animals, the last ones before.
    """
    height, width = (math.ceil(side / COARSE) for side in camera.image_hw)
    coarse = torch.tensor([[1 / COARSE, 0, 0], [0, 1 / COARSE, 0], [0, 0, 1]], dtype=torch.float64)
    K, faces = coarse @ camera.K, load_quadruped().faces
    while len(animals) > 1 or things:
        parts = [(a.vertices, faces) for a in animals] + [(t.vertices, t.faces) for t in things]
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)]).tolist()
        vertices = transform_points(
            camera.T_cam_world, torch.cat([vertices for vertices, _ in parts])
        )
        all_faces = torch.cat([f + s for (_, f), s in zip(parts, starts[:-1], strict=True)])
        face_index = rasterize(vertices, all_faces, K, (height, width)).face_index
        first = vertices[: len(animals[0].vertices)]
        whole = int(silhouette(first, faces, K, (height, width)).sum())
        visible = int(((face_index >= 0) & (face_index < len(faces))).sum())
        if visible >= LEAST_SEEN * whole:
            break
        animals, things = (animals, things[:-1]) if things else (animals[:-1], things)
    return animals, things


def _things(
    rng: np.random.Generator,
    animals: tuple[StandingAnimal, ...],
    camera: PinholeCamera,
    config: WorldConfig,
) -> tuple[Thing, ...]:
    """Occluders between the camera and the first animal, and things anywhere."""
    things: list[Thing] = []
    places: list[tuple[Place, float]] = [(a.place.numpy(), a.reach) for a in animals]
    if rng.random() < config.occluded:
        for _ in range(int(rng.integers(1, 4))):
            kind, place = _before(rng, animals[0], camera)
            _add(make_thing(rng, kind, place), place, things, places, camera=camera)
    if config.occluded and rng.random() < EXTRAS:
        for _ in range(int(rng.integers(1, 5))):
            kind = (*OCCLUDERS, "tree")[int(rng.integers(len(OCCLUDERS) + 1))]
            angle, distance = rng.uniform(-np.pi, np.pi), rng.uniform(1.0, 5.0)
            direction = np.array([np.cos(angle), np.sin(angle)])
            place = animals[0].place.numpy() + distance * direction
            _add(make_thing(rng, kind, place), place, things, places, camera=camera)
    return tuple(things)


def _before(
    rng: np.random.Generator, animal: StandingAnimal, camera: PinholeCamera
) -> tuple[str, Place]:
    """A random kind of occluder, and a place for it between the animal and the camera."""
    eye = camera.center_world.numpy()
    towards = eye[:2] - animal.place.numpy()
    distance = float(np.linalg.norm(eye - np.array([*animal.place.tolist(), 0.4])))
    sine = eye[2] / max(distance, 1e-9)
    kinds = next(kinds for limit, kinds in HIDING if sine < limit)
    kind = kinds[int(rng.integers(len(kinds)))]
    along = towards / max(float(np.linalg.norm(towards)), 1e-9)
    aside = np.array([-along[1], along[0]])
    apart = animal.reach + REACH[kind] + GAP + rng.uniform(0.01, 0.15)
    spread = animal.reach * rng.uniform(-0.6, 0.6)
    forward = along * (apart**2 - min(spread**2, apart**2 / 2)) ** 0.5
    return kind, animal.place.numpy() + forward + aside * spread * 1.05


def _add(
    thing: Thing,
    place: Place,
    things: list[Thing],
    places: list[tuple[Place, float]],
    *,
    camera: PinholeCamera,
) -> None:
    """Add a thing to the scene unless it would stand in something, or close before the camera.

    Args:
        thing: at its place.
        place: (2,) of the thing.
        things: of the scene so far, to which it is added.
        places: place and reach of all animals and things so far, to which its own are added.
        camera: of the scene.

    """
    reach = REACH[thing.kind]
    if any(float(np.hypot(*(place - other))) < radius + reach + GAP for other, radius in places):
        return
    _, depth = camera.project(thing.vertices)
    distance = torch.linalg.vector_norm(thing.vertices - camera.center_world, dim=1)
    near = float(distance.amin()) < CLEAR_DEPTH
    if near or float(depth.amax()) > 0 > float(depth.amin()):
        return
    things.append(thing)
    places.append((place, reach))
