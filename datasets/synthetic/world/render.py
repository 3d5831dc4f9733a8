"""From the plan of a scene to its picture."""

from collections.abc import Callable

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

SENSOR_NOISE = 4
"""Each channel of each pixel is off by up to so many of its 256 steps."""


def surfaces_of(plan: ScenePlan) -> list[Surface]:
    """The animals, then the things."""
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
    """The picture of a scene; owner counts the animals first, then the things."""
    surfaces = surfaces_of(plan)
    casters = surfaces if plan.ground_z == 0 else surfaces[len(plan.animals) :]
    empty = background(
        plan.setting, plan.camera, plan.ground_z, [(s.vertices, s.faces) for s in casters]
    )
    made = render(surfaces, plan.camera, empty, Light(plan.setting.sun, plan.setting.sunny))
    return Rendering(
        _noisy(made.image, world_generator(plan.seed, plan.index, "noise")), made.owner, made.raster
    )


def _coat(coat: Coat) -> Callable[[Values], Values]:
    return lambda features: coat_colors(coat, features)


def _grained(thing: Thing) -> Callable[[Values], Values]:
    """Colours of a thing: its own, darker and lighter in grains."""
    amount, cycles = thing.grain
    color, stem = (np.array(c, dtype=np.float32) for c in (thing.color, thing.stem or thing.color))

    def colors(places: Values) -> Values:
        x, y, z = cycles * places.T
        grain = np.sin(x + 1.7 * np.sin(0.8 * y)) * np.sin(
            y + 1.3 * np.sin(0.9 * z)
        ) + 0.7 * np.sin(2.3 * z + 2.1 * np.sin(x)) * np.sin(2.7 * x - y)
        return np.asarray(
            np.where(places[:, 2:] < CROWN_BOTTOM, stem, color)
            * (1 + amount * 0.6 * grain[:, None]),
            dtype=np.float32,
        )

    return colors


def _noisy(image: Tensor, rng: np.random.Generator) -> Tensor:
    """The image with a sensor's noise."""
    noise = rng.integers(-SENSOR_NOISE, SENSOR_NOISE + 1, image.shape, dtype=np.int8)
    return torch.from_numpy((image.numpy().astype(np.int16) + noise).clip(0, 255).astype(np.uint8))
