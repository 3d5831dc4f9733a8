"""Memory that a thread uses again for one picture after the other."""

import threading

import numpy as np

MOST_BYTES = 1 << 23
"""Pictures that take more memory than this get memory of their own, which is freed after use."""


class Scratch(threading.local):
    """Memory for pictures that live within one function: copies that are only read once.

    Memory that the system gives anew costs a worker 1 us a page of 4 KiB, and so half as much as
    reading a picture for a warp. What lies in scratch memory is overwritten by the thread's next
    picture, so none of it may be given away.

    Example:
        >>> first = SCRATCH.array("example", (4, 6), np.dtype(np.uint8))
        >>> again = SCRATCH.array("example", (2, 3), np.dtype(np.uint8))
        >>> again.shape, np.shares_memory(first, again)
        ((2, 3), True)
    """

    def __init__(self) -> None:
        self._memory: dict[str, np.ndarray] = {}

    def array(self, use: str, shape: tuple[int, ...], dtype: np.dtype[np.generic]) -> np.ndarray:
        """An array whose values are what the last picture left there.

        Args:
            use: what for: two uses never share memory.
            shape: of the array.
            dtype: of the array.
        """
        array: np.ndarray
        size = int(np.prod(shape)) * dtype.itemsize
        if size > MOST_BYTES:
            array = np.empty(shape, dtype)
            return array
        memory = self._memory.get(use)
        if memory is None or memory.size < size:
            memory = self._memory[use] = np.empty(size, np.uint8)
        array = memory[:size].view(dtype).reshape(shape)
        return array


SCRATCH = Scratch()
"""Each thread's own."""
