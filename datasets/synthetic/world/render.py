"""The picture of a planned scene: its surfaces, drawn and given a sensor's noise."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.datasets.synthetic.world.coats import Coat, coat_colors, template_features
from animal3dbox.datasets.synthetic.world.config import world_generator
from animal3dbox.datasets.synthetic.world.ground import background
from animal3dbox.datasets.synthetic.world.scene import ScenePlan
from animal3dbox.datasets.synthetic.world.shading import Light, Rendering, Surface, render
from animal3dbox.datasets.synthetic.world.things import CROWN_BOTTOM, Thing
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Values = NDArray[np.float32]
"""Values of points, such as colours (N, 3)."""

SENSOR_NOISE = 4
"""Greatest noise of a pixel's channel, in its 256 steps."""


def surfaces_of(plan: ScenePlan) -> list[Surface]:
    """The surfaces of a scene: the animals', then the things'."""
    faces, features = load_quadruped().faces, template_features()
    animals = [
        Surface(a.vertices, faces, features, _coat(coat))
        for a, coat in zip(plan.animals, plan.coats, strict=True)
    ]
    return animals + [
        Surface(t.vertices, t.faces, t.vertices.numpy().astype(np.float32), _grained(t))
        for t in plan.things
    ]


def render_scene(plan: ScenePlan) -> Rendering:
    """The picture of a scene, whose owners count the animals first, then the things."""
    surfaces = surfaces_of(plan)
    casters = surfaces if plan.ground_z == 0 else surfaces[len(plan.animals) :]
    empty = background(
        plan.setting, plan.camera, plan.ground_z, [(s.vertices, s.faces) for s in casters]
    )
    light = Light(plan.setting.sun, plan.setting.sunny)
    rendering = render(surfaces, plan.camera, empty, light)
    noise = world_generator(plan.seed, plan.index, "noise")
    return replace(rendering, image=_noisy(rendering.image, noise))


def _coat(coat: Coat) -> Callable[[Values], Values]:
    """The colours of a coat as a function of template features."""
    return lambda features: coat_colors(coat, features)


def _grained(thing: Thing) -> Callable[[Values], Values]:
    """The colours of a thing as a function of places: its own, darker and lighter in grains."""
    amount, cycles = thing.grain
    color, stem = (np.array(c, dtype=np.float32) for c in (thing.color, thing.stem or thing.color))

    def colors(places: Values) -> Values:
        x, y, z = cycles * places.T
        coarse = np.sin(x + 1.7 * np.sin(0.8 * y)) * np.sin(y + 1.3 * np.sin(0.9 * z))
        fine = 0.7 * np.sin(2.3 * z + 2.1 * np.sin(x)) * np.sin(2.7 * x - y)
        base = np.where(places[:, 2:] < CROWN_BOTTOM, stem, color)
        brightness = 1 + amount * 0.6 * (coarse + fine)[:, None]
        return np.asarray(base * brightness, dtype=np.float32)

    return colors


def _noisy(image: Tensor, rng: np.random.Generator) -> Tensor:
    """An image (H, W, 3) uint8 with a sensor's noise."""
    noise = rng.integers(-SENSOR_NOISE, SENSOR_NOISE + 1, image.shape, dtype=np.int8)
    return torch.from_numpy((image.numpy().astype(np.int16) + noise).clip(0, 255).astype(np.uint8))
