"""The body source that a user's option names: a preset, a model's file or a mesh file."""

from pathlib import Path

from animal3dbox.datasets.bodies.fitted import FIT, FittedBodies
from animal3dbox.datasets.bodies.mesh_file import landmark_ids, load_mesh_body
from animal3dbox.datasets.bodies.presets import PRESET, PresetBodies
from animal3dbox.datasets.bodies.sources import BodySource, ModelBody, preset_body
from animal3dbox.datasets.bodies.species import AUTO
from animal3dbox.errors import ConfigError
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

DEFAULT_BODY = FIT
"""The body of the animals of a dataset that comes with no bodies."""


def body_source(
    body: str,
    landmarks: Path | None = None,
    *,
    species: str = AUTO,
    model: Path | None = None,
) -> BodySource:
    """The source of bodies that the command line's --body and --landmarks name.

    Args:
        body: a preset's name, "preset" for that of each animal's category, "fit" for a body fitted
            to each animal, a model's file (.pkl or .safetensors), or a mesh file.
        landmarks: where the mesh file has its landmarks, see load_mesh_body; of a pickle that is
            fitted and has none of its own, lists of vertex ids.
        species: of fitted animals and presets, see FittedBodies and PresetBodies.
        model: with "fit", the file of the model that is fitted; None: the embedded quadruped.

    Raises:
        ConfigError: a mesh file without landmarks, an unknown preset or species, or a species or a
            model for bodies that are not fitted.
        ModelFileError: the model's file is refused.

    """
    if body == FIT:
        return FittedBodies(_fitted_model(model, landmarks), species)
    if species != AUTO and body != PRESET:
        raise ConfigError(
            f"species={species!r} is for bodies 'fit' and 'preset': leave it out, or {body!r}"
        )
    if model is not None:
        raise ConfigError(f"a model is for fitted bodies, and {body!r} is none: leave one of them")
    if landmarks is not None:
        return load_mesh_body(Path(body), landmarks)
    if Path(body).suffix.lower() in (".pkl", ".safetensors"):
        return ModelBody(load_model(Path(body)), f"model:{Path(body).name}")
    if "." in body or "/" in body:
        raise ConfigError(
            f"--body {body} is a file: give --landmarks too, or there is no telling its nose from"
            " its tail"
        )
    return PresetBodies(species) if body == PRESET else preset_body(body)


def _fitted_model(path: Path | None, landmarks: Path | None) -> SmalModel:
    """The model that is fitted, with the landmarks of a file where it has none of its own."""
    if path is not None:
        return load_model(path, None if landmarks is None else landmark_ids(landmarks))
    if landmarks is not None:
        raise ConfigError("the embedded quadruped has landmarks of its own: give a --model too")
    return load_quadruped()
