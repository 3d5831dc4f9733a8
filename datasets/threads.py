"""One thread for what a sample needs: its problems are small, and threads of a forked parent hang their children."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import torch
from torch.utils.data import get_worker_info

_before_fork: list[int] = []


@contextmanager
def one_thread() -> Iterator[None]:
    """Run with one thread of torch and of OpenCV, so that sums are the same in the main process and in every worker.

    In a worker they stay at one; in the main process they go back to what they were.
    """
    torch_threads, cv2_threads = torch.get_num_threads(), cv2.getNumThreads()
    if torch_threads != 1:
        torch.set_num_threads(1)
    if cv2_threads != 1:
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        if get_worker_info() is None:
            if torch_threads != 1:
                torch.set_num_threads(torch_threads)
            if cv2_threads != 1:
                cv2.setNumThreads(cv2_threads)


def _end_threads() -> None:
    """End OpenCV's threads before a fork: a child has none of them, and would wait for them for ever as soon as it set their number."""
    _before_fork.append(cv2.getNumThreads())
    if _before_fork[-1] != 1:
        cv2.setNumThreads(1)


def _start_threads() -> None:
    threads = _before_fork.pop()
    if threads != 1:
        cv2.setNumThreads(threads)


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(before=_end_threads, after_in_parent=_start_threads, after_in_child=_before_fork.clear)
