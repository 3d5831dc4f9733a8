"""Scenes of the synthetic world in a folder: drawn once, read afterwards."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.sightings import NO_SIGHTING
from animal3dbox.datasets.storage.codec import Codec
from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.datasets.synthetic.scene_files import content_of
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.files import user_path, write_whole
from animal3dbox.smal.parameters import SmalParameters

_DIGEST = 16
"""Bytes of the checksum with which a file begins."""
_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1]


@dataclass(frozen=True, eq=False)
class AnnotatedScene:
    """A scene as a dataset has it: a picture and its annotated animals.

    Attributes:
        records: the animals.
        parameters: of their bodies as annotated, in the same order.
        K: (3, 3) the camera's intrinsics in px.
        image_hw: height and width.
        png: the picture, without loss.
    """

    records: tuple[AnimalRecord, ...]
    parameters: tuple[SmalParameters, ...]
    K: NDArray[np.float64]
    image_hw: tuple[int, int]
    png: bytes

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """The picture (H, W, 3) RGB, decoded anew."""
        png = np.frombuffer(self.png, np.uint8)
        return np.asarray(cv2.imdecode(png, cv2.IMREAD_COLOR_RGB), dtype=np.uint8)


def png_of(pixels: NDArray[np.uint8]) -> bytes:
    """A picture (H, W, 3) RGB as PNG."""
    return cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), _FAST)[1].tobytes()


class SceneStore:
    """The scenes of one synthetic set in a folder.

    Any number of processes may share it. Sets that differ in anything, be it the code that draws
    them, have folders of their own inside. A damaged file is as good as none.

    Args:
        folder: of the user's.
        scenes: the set.

    """

    def __init__(self, folder: Path | str, scenes: SyntheticSet) -> None:
        name = digest(msgspec.json.encode(content_of(scenes)))
        self.folder = user_path(folder) / name.hex()
        self._codec = Codec((scenes.config.vocabulary,))

    def get(self, index: int) -> AnnotatedScene | None:
        """A scene; None if it cannot be read, or is damaged."""
        try:
            content = self._path(index).read_bytes()
        except OSError:
            return None
        checksum, packed = content[:_DIGEST], content[_DIGEST:]
        return self._unpacked(packed) if digest(packed) == checksum else None

    def put(self, index: int, scene: AnnotatedScene) -> None:
        """Store a scene; a folder that takes none costs a warning, not the sample."""
        packed = self._codec.pack(
            {
                "records": [self._codec.pack(record) for record in scene.records],
                "parameters": [self._codec.pack(one) for one in scene.parameters],
                "K": scene.K,
                "image_hw": scene.image_hw,
                "png": scene.png,
            }
        )
        try:
            write_whole(self._path(index), digest(packed) + packed)
        except OSError as error:
            warnings.warn(f"scenes cannot be stored and are drawn anew: {error}", stacklevel=2)

    def _path(self, index: int) -> Path:
        return self.folder / f"{index // 1000:06d}" / f"{index:09d}.scene"

    def _unpacked(self, packed: bytes) -> AnnotatedScene:
        fields = self._codec.unpack(packed)
        records = (self._codec.unpack(one) for one in fields["records"])
        parameters: list[dict[str, Any]] = [self._codec.unpack(one) for one in fields["parameters"]]
        return AnnotatedScene(
            records=tuple(AnimalRecord(**{**one, "sighting": NO_SIGHTING}) for one in records),
            parameters=tuple(SmalParameters(**one) for one in parameters),
            K=fields["K"],
            image_hw=fields["image_hw"],
            png=fields["png"],
        )
