"""A body source by what a user says: a preset's name or a file."""

from pathlib import Path

from animal3dbox.datasets.bodies.mesh_file import load_mesh_body
from animal3dbox.datasets.bodies.sources import BodySource, ModelBody, preset_body
from animal3dbox.errors import ConfigError
from animal3dbox.smal.files.model_files import load_model

DEFAULT_BODY = "dog"


def body_source(body: str, landmarks: Path | None = None) -> BodySource:
    """The source of a preset's name, of a model's file, or of a mesh file with its landmarks.

    Raises:
        ConfigError: a mesh file without landmarks, or an unknown preset.

    """
    if landmarks is not None:
        return load_mesh_body(Path(body), landmarks)
    if Path(body).suffix.lower() in (".pkl", ".safetensors"):
        return ModelBody(load_model(Path(body)), f"model:{Path(body).name}")
    if "." in body or "/" in body:
        raise ConfigError(
            f"--body {body} is a file: give --landmarks too, or there is no telling its nose from"
            " its tail"
        )
    return preset_body(body)
