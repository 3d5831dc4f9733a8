"""The commands that read no dataset: what is installed, which keypoints are known, a body's file.

They are part of jobs.py's list of commands, and of the same kind.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


@dataclass(frozen=True, kw_only=True)
class ConvertModelJob:
    """Convert a SMAL pickle to safetensors, without running anything the pickle names.

    Example: animal3dbox convert-model smal.pkl smal.safetensors
    """

    source: Annotated[Positional[Path], arg(metavar="IN")]
    """a SMAL model, .pkl or .safetensors"""
    target: Annotated[Positional[Path], arg(metavar="OUT")]
    """the .safetensors file to write"""
    landmarks: Path | None = None
    """JSON with the vertices of the landmarks of a pickle whose mesh is not SMAL's"""


@dataclass(frozen=True, kw_only=True)
class VocabulariesJob:
    """List the keypoint vocabularies, or where on a body each keypoint of one is.

    Example: animal3dbox vocabularies ap10k17
    """

    name: Annotated[Positional[str | None], arg(metavar="[NAME]")] = None
    """of a vocabulary, or a TOML file of your own; without: all, and the places on a body"""


@dataclass(frozen=True, kw_only=True)
class DoctorJob:
    """Tell what is installed here, whether it works, and what each missing extra costs.

    Example: animal3dbox doctor --json
    """

    cache: Path = Path("labels-cache")
    """the label cache's folder, to see if it can be written to"""
    json: bool = False
    """print JSON instead of words"""
