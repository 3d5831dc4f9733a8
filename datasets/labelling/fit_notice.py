"""What a loader's worker says, once, of bodies that it fits while a model trains."""

import sys
from collections.abc import Sequence, Sized

from torch.utils.data import get_worker_info

from animal3dbox.errors import SampleError
from animal3dbox.labels.fit.fitted_observation import FITTED
from animal3dbox.labels.types import CuboidLabel, Rejection

THOUSAND = 1000


class FitNotice:
    """Tells on stderr what fits cost an epoch, the first time that a worker makes one.

    A fit costs some fifty JPEG decodes, every epoch anew without a cache.

    Example:
        >>> FitNotice().tell([], seconds=0.0)  # nothing was fitted, and this is no worker
    """

    def __init__(self) -> None:
        self._is_told = False

    def tell(
        self, outcomes: Sequence[CuboidLabel | Rejection | SampleError], seconds: float
    ) -> None:
        """Say what labels just made in a worker mean for an epoch, if bodies were fitted.

        Args:
            outcomes: of animals labelled together.
            seconds: that they took.

        """
        fits = sum(isinstance(one, CuboidLabel) and one.quality.body == FITTED for one in outcomes)
        worker = get_worker_info()
        if self._is_told or not fits or worker is None:
            return
        self._is_told = True
        if worker.id == 0:
            images = len(worker.dataset) if isinstance(worker.dataset, Sized) else None
            sys.stderr.write(self._sentence(seconds / len(outcomes), images, worker.num_workers))

    @staticmethod
    def _sentence(seconds: float, images: int | None, workers: int) -> str:
        """What is said.

        Args:
            seconds: an animal.
            images: of an epoch; None if they cannot be counted.
            workers: that share them.

        """
        epoch = f"{seconds * THOUSAND / 60:.0f} min a thousand animals in each worker"
        if images is not None:
            minutes = max(1, round(seconds * images / workers / 60))
            epoch = f"about {minutes} min an epoch, if its {images} images show an animal each"
        return (
            f"animal3dbox: bodies are being fitted while this loads, {seconds:.2f} s an animal:"
            f" {epoch}. Fill a cache once, with animal3dbox label PATH --cache FOLDER, and give the"
            " Dataset cache=FOLDER.\n"
        )
