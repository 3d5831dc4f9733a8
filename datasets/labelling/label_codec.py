"""Labels as bytes: what the cache stores."""

from typing import Any

import msgspec
import numpy as np

from animal3dbox.errors import ShapeError
from animal3dbox.labels.fit_parameters import FitParameters
from animal3dbox.labels.label_row import WIDTH
from animal3dbox.labels.types import CuboidLabel, Quality, Rejection


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot be packed")


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)
_Fit = tuple[str, str, str, bytes, bytes]
"""FitParameters: the body's name, its digest and the vocabulary's name, betas and pose."""
_LABEL = msgspec.msgpack.Decoder(
    tuple[
        str,
        tuple[int, int],
        bytes,
        bytes | None,
        Quality,
        float | None,
        str,
        bytes | None,
        _Fit | None,
    ]
)
_REJECTION = msgspec.msgpack.Decoder(tuple[str | None, str, str])


def packed_outcome(outcome: CuboidLabel | Rejection) -> bytes:
    """The bytes of a label or a rejection, the same for the same content."""
    if isinstance(outcome, Rejection):
        return b"R" + _ENCODER.encode((outcome.sample_id, outcome.reason, outcome.detail))
    keypoints, lens = (
        None if part is None else part.astype(np.float64).tobytes()
        for part in (outcome.keypoints_2d, outcome.lens)
    )
    return b"L" + _ENCODER.encode(
        (
            outcome.sample_id or "",
            outcome.image_hw,
            outcome.row.tobytes(),
            keypoints,
            outcome.quality,
            outcome.scale_m_per_unit,
            outcome.scale_source,
            lens,
            None if outcome.fit is None else _packed_fit(outcome.fit),
        )
    )


def unpacked_outcome(data: bytes) -> CuboidLabel | Rejection:
    """The label or rejection of its bytes; a label's arrays cannot be written to.

    Raises:
        ShapeError: the bytes are of another layout.

    """
    kind = data[:1]
    if kind == b"R":
        return Rejection(*_REJECTION.decode(data[1:]))
    if kind != b"L":
        raise ShapeError(f"an outcome must be a label or a rejection, got kind {kind!r}")
    sample_id, image_hw, row, keypoints, quality, scale, scale_source, lens, fit = _LABEL.decode(
        data[1:]
    )
    numbers = np.frombuffer(row)
    if len(numbers) != WIDTH:
        raise ShapeError(f"a label must have {WIDTH} numbers, got {len(numbers)}")
    return CuboidLabel(
        sample_id=sample_id,
        image_hw=image_hw,
        row=numbers,
        keypoints_2d=None if keypoints is None else np.frombuffer(keypoints).reshape(-1, 3),
        quality=quality,
        lens=None if lens is None else np.frombuffer(lens),
        scale_m_per_unit=scale,
        scale_source=scale_source,
        fit=None if fit is None else _unpacked_fit(fit),
    )


def _packed_fit(fit: FitParameters) -> _Fit:
    """The parts of a fit as they are stored."""
    betas, pose = (part.astype(np.float64).tobytes() for part in (fit.betas, fit.pose))
    return fit.body, fit.digest, fit.vocabulary, betas, pose


def _unpacked_fit(fit: _Fit) -> FitParameters:
    """The fit of its stored parts."""
    body, digest, vocabulary, betas, pose = fit
    return FitParameters(
        body, digest, vocabulary, np.frombuffer(betas), np.frombuffer(pose).reshape(-1, 3)
    )
