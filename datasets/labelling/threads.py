"""One thread for what a sample needs: its problems are small, and forked threads would hang."""

import os
from contextlib import AbstractContextManager

import cv2
import torch
from torch.utils.data import get_worker_info

_before_fork: list[int] = []


def one_thread() -> AbstractContextManager[None]:
    """A context with one thread of torch and of OpenCV: sums are then the same in every process.

    In a worker they stay at one; in the main process they go back to what they were.
    """
    return _OneThread()


class _OneThread(AbstractContextManager[None]):
    """The context of one_thread; a generator would cost each sample more (benchmarks/loader.py)."""

    def __enter__(self) -> None:
        self.before = torch.get_num_threads(), cv2.getNumThreads()
        if self.before != (1, 1):
            _set_threads(1, 1)

    def __exit__(self, *error: object) -> None:
        if self.before != (1, 1) and get_worker_info() is None:
            _set_threads(*self.before)


def _set_threads(of_torch: int, of_cv2: int) -> None:
    """Set the numbers of threads, where they are not so already."""
    if torch.get_num_threads() != of_torch:
        torch.set_num_threads(of_torch)
    if cv2.getNumThreads() != of_cv2:
        cv2.setNumThreads(of_cv2)


def _end_threads() -> None:
    """End OpenCV's threads before a fork.

    A child has none of them, and would wait for them for ever as soon as it set their number.
    """
    _before_fork.append(cv2.getNumThreads())
    if _before_fork[-1] != 1:
        cv2.setNumThreads(1)


def _start_threads() -> None:
    """Give the parent its threads back after a fork."""
    threads = _before_fork.pop()
    if threads != 1:
        cv2.setNumThreads(threads)


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(
        before=_end_threads, after_in_parent=_start_threads, after_in_child=_before_fork.clear
    )
