"""Annotations in tensors: what is sent to another process moves, and is read all the same."""

import io
from multiprocessing.reduction import ForkingPickler

import torch

from animal3dbox.datasets.storage.packed import Arena


def test_pieces_are_read_where_torch_has_moved_them() -> None:
    parts = [bytes([i]) * 200_000 for i in range(8)]
    arena = Arena(parts)
    assert [arena[i] for i in range(8)] == parts
    ForkingPickler(io.BytesIO()).dump(
        arena
    )  # as a spawned worker gets it: by shared memory, which torch moves the tensors to
    overwritten = [torch.full((200_001,), 7, dtype=torch.uint8) for _ in range(20)] + [
        torch.full((9,), 3) for _ in range(1000)
    ]
    assert [arena[i] for i in range(8)] == parts
    assert len(arena) == 8
    assert len(overwritten) == 1020
