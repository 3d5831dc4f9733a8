"""The coats of animals: colours as functions of places on the template.

So they stick to the body in every shape and pose.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.synthetic.world.shading import vertex_normals
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Values = NDArray[np.float32]
"""Values of points, such as colours (N, 3)."""
Color = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""

KINDS = ("plain", "patches", "stripes", "countershading", "spots")
"""The kinds of coats."""
_WAVES = 7
"""Number of waves of a coat's noise."""
EYE_RADIUS, NOSE_RADIUS, HOOF_HEIGHT = 0.013, 0.022, 0.022
"""Sizes of dark skin on the template, which is a unit long."""

_BASES: dict[str, tuple[tuple[str, ...], tuple[Color, ...]]] = {
    "dog": (("plain", "patches", "countershading"),
            ((0.66, 0.47, 0.28), (0.20, 0.17, 0.15), (0.80, 0.72, 0.60), (0.45, 0.30, 0.18))),
    "cat": (("stripes", "patches", "plain", "countershading"),
            ((0.60, 0.50, 0.40), (0.75, 0.50, 0.28), (0.30, 0.28, 0.27))),
    "horse": (("plain", "patches", "countershading"),
              ((0.42, 0.25, 0.15), (0.25, 0.17, 0.12), (0.70, 0.66, 0.62), (0.58, 0.38, 0.22))),
    "cow": (("patches", "plain", "countershading"),
            ((0.84, 0.80, 0.75), (0.50, 0.30, 0.18), (0.75, 0.62, 0.46))),
    "bear": (("plain", "countershading"),
             ((0.34, 0.23, 0.16), (0.16, 0.13, 0.12), (0.88, 0.86, 0.80))),
    "deer": (("countershading", "spots", "plain"), ((0.60, 0.40, 0.23), (0.50, 0.38, 0.27))),
    "zebra": (("stripes",), ((0.86, 0.84, 0.80),)),
    "pig": (("plain", "patches", "plain"), ((0.88, 0.67, 0.60), (0.55, 0.42, 0.36))),
    "hippo": (("countershading", "plain"), ((0.46, 0.39, 0.39), (0.40, 0.36, 0.37))),
    "lion": (("countershading", "plain"), ((0.76, 0.59, 0.36), (0.68, 0.52, 0.34))),
}  # fmt: skip
"""Species -> the kinds of coats that it has, and its ground colours."""
_OTHER: tuple[tuple[str, ...], tuple[Color, ...]] = (
    KINDS,
    ((0.60, 0.50, 0.40), (0.35, 0.30, 0.26)),
)
_USUAL = 0.8
"""Part of the animals whose kind of coat is one that their species has."""


@dataclass(frozen=True)
class Coat:
    """One animal's coat: its kind, its colours and its noise.

    Attributes:
        kind: of KINDS.
        base: the ground colour.
        mark: the colour of marks, or of the belly.
        waves: (3, W) wave vectors of the noise.
        phases: (W,) of the noise.
        level: value of the noise at which marks begin.
        points: part by which legs, head and tail are darker.
    """

    kind: str
    base: Color
    mark: Color
    waves: Values
    phases: Values
    level: float
    points: float


def draw_coat(rng: np.random.Generator, preset: str) -> Coat:
    """A random coat for a species, most often of a kind that it has."""
    kinds, bases = _BASES.get(preset, _OTHER)
    kind = kinds[int(rng.integers(len(kinds)))]
    if rng.random() > _USUAL and preset != "zebra":
        kind = KINDS[int(rng.integers(len(KINDS)))]
    tone = (
        np.array(bases[int(rng.integers(len(bases)))])
        * rng.uniform(0.85, 1.12)
        * rng.uniform(0.96, 1.04, 3)
    )
    base = tone.clip(0.04, 0.93)
    if kind == "countershading":
        mark = base + (0.93 - base) * rng.uniform(0.45, 0.75)
    elif base.mean() > 0.5:
        mark = base * rng.uniform(0.10, 0.35) * np.array([1.0, 0.9, 0.8])
    else:
        mark = base + (np.array([0.92, 0.89, 0.84]) - base) * rng.uniform(0.7, 1.0)
    if kind == "spots" and base.mean() <= 0.62:  # a fawn's
        mark = base + (np.array([0.93, 0.9, 0.85]) - base) * 0.6
    cycles = {"patches": 8.0, "spots": 55.0}.get(kind, 9.0) * rng.uniform(0.8, 1.3)
    waves = rng.standard_normal((3, _WAVES))
    waves *= cycles * rng.uniform(0.7, 1.4, _WAVES) / np.linalg.norm(waves, axis=0)
    # The order of these is that of the random numbers.
    return Coat(
        kind=kind,
        base=_color(base),
        mark=_color(mark),
        waves=waves.astype(np.float32),
        phases=rng.uniform(0, 6.28, _WAVES).astype(np.float32),
        level=float(rng.uniform(-0.25, 0.3)),
        points=float(rng.uniform(0, 0.5) if rng.random() < 0.5 else 0.0),
    )


def _color(value: NDArray[np.float64]) -> Color:
    """An array (3,) as a colour."""
    return float(value[0]), float(value[1]), float(value[2])


def coat_colors(coat: Coat, features: Values) -> Values:
    """The colours (N, 3), 0 to 1, of points of a coat.

    Args:
        coat: of the animal.
        features: (N, 8) of the points, as template_features has them.

    """
    x, y, z, up, leg, head, tail, dark = features.T
    noise = np.sin(features[:, :3] @ coat.waves + coat.phases).sum(1) / _WAVES**0.5
    base, mark = np.array(coat.base, dtype=np.float32), np.array(coat.mark, dtype=np.float32)
    if coat.kind == "patches":
        part = _step(noise - coat.level, 0.06)
    elif coat.kind == "spots":
        part = _step(noise - 0.75, 0.15) * (1 - 0.7 * leg)
    elif coat.kind == "stripes":
        on_trunk = x * (1 - leg) * (1 + 0.4 * head) + 0.25 * z * (1 - leg)
        flow = 2 * np.pi * (13.0 + 3 * coat.level) * (on_trunk + 1.3 * z * leg + 0.012 * noise)
        part = _step(np.sin(flow) - 0.1 + 1.2 * np.clip(-up - 0.3, 0, 1), 0.25)
    elif coat.kind == "countershading":
        part = _step(-up - 0.15 + 0.15 * noise, 0.55)
    else:
        part = 0.05 * noise
    colors = base + (mark - base) * np.clip(part, 0, 1)[:, None]
    dark_points = np.clip(leg * (1 - z / 0.4) + 0.6 * head + 0.7 * tail, 0, 1)
    colors *= (1 - coat.points * dark_points)[:, None]
    hair = np.sin(150 * x + 95 * y + 2.5 * noise) * np.sin(130 * z - 60 * y - 2.0 * noise)
    colors *= (1 + 0.03 * noise + 0.01 * hair)[:, None]
    return np.asarray(colors * (1 - 0.9 * np.clip(dark, 0, 1))[:, None], dtype=np.float32)


def _step(value: Values, width: float) -> Values:
    """0 below and 1 above zero, smooth over a width: the smoothstep function."""
    part = np.clip(value / width + 0.5, 0, 1)
    return np.asarray(part * part * (3 - 2 * part))


@cache
def template_features() -> Values:
    """The features (V, 8) of the vertices of the quadruped's template that coats depend on.

    They are the place x, y, z, the normal's z, how much the vertex belongs to legs, head and tail,
    and how dark its skin is.
    """
    model = load_quadruped()
    place, normals = model.v_template, vertex_normals(model.v_template, model.faces)
    parts = [
        _weight(model, names) for names in (("Leg", "Foot"), ("Head", "Mouth", "Ear"), ("Tail",))
    ]
    dark = torch.zeros(model.vertex_count, dtype=torch.float64)
    for names, radius in ((("left_eye", "right_eye"), EYE_RADIUS), (("nose",), NOSE_RADIUS)):
        for name in names:
            apart = torch.linalg.vector_norm(
                place - place[list(model.landmarks[name])].mean(0), dim=1
            )
            dark = torch.maximum(dark, (1.6 - apart / radius).clamp(0, 1))
    dark = torch.maximum(dark, 0.75 * (1.5 - place[:, 2] / HOOF_HEIGHT).clamp(0, 1))
    features = torch.stack((*place.unbind(1), normals[:, 2], *parts, dark), dim=1)
    return np.asarray(features.numpy(), dtype=np.float32)


def _weight(model: SmalModel, names: tuple[str, ...]) -> torch.Tensor:
    """The skinning weight (V,) of the joints whose names hold one of these."""
    joints = [
        i for i, joint in enumerate(model.joint_names) if any(name in joint for name in names)
    ]
    return model.weights[:, joints].sum(1)
