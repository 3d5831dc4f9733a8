"""The progress bars of the command line; nothing else shows any.

Long loops name themselves by `watched`, wherever they are. A bar appears if the command line asked
for bars in this process and stderr is a terminal: a log, a notebook and a training loop get none.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
_process: ContextVar[int | None] = ContextVar("process that shows bars", default=None)


@contextmanager
def progress_bars() -> Iterator[None]:
    """Let the loops of the ``with`` block show bars, but not those of worker processes.

    Example:
        >>> with progress_bars():
        ...     sum(watched(range(4), "adding", unit="number"))  # stderr is no terminal here
        6
    """
    token = _process.set(os.getpid())
    try:
        yield
    finally:
        _process.reset(token)


def watched(
    items: Iterable[T], what: str, *, unit: str, total: int | None = None, initial: int = 0
) -> Iterable[T]:
    """The items one by one; a bar, which goes when the loop ends, counts them.

    Args:
        items: any iterable; without a length, give total.
        what: is done to them, "labelling".
        unit: what one is, "image".
        total: number of items, with those before; None: their length, if they have one.
        initial: number of items that were done before.

    Example:
        >>> [2 * number for number in watched([1, 2], "doubling", unit="number")]
        [2, 4]
    """
    if _process.get() != os.getpid():
        return items
    from tqdm import tqdm  # here, so that `--help` does not wait for it

    return tqdm(
        items, desc=what, unit=f" {unit}", total=total, initial=initial, disable=None, leave=False
    )


@contextmanager
def watched_steps(what: str, *, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Give a function that is told (done, total) as work goes on, and moves a bar.

    Example:
        >>> with watched_steps("learning", unit="step") as watch:
        ...     watch(1, 2)
    """
    from tqdm import tqdm  # as above

    is_hidden = True if _process.get() != os.getpid() else None
    with tqdm(desc=what, unit=f" {unit}", disable=is_hidden, leave=False) as bar:

        def watch(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield watch
