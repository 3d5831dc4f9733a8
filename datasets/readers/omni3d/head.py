"""The head of an Omni3D file, "info": who wrote it, and what its lengths and pixels are."""

from dataclasses import dataclass, replace
from typing import Any

import msgspec

from animal3dbox.datasets.readers.cuboid_checks import Metric
from animal3dbox.datasets.readers.cuboid_conventions import OMNI3D, Convention
from animal3dbox.datasets.readers.omni3d.schema import GENERATOR

METRES = frozenset({"m", "metre", "metres", "meter", "meters"})
"""Words of info.units for metres."""


@dataclass(frozen=True)
class StatedHead:
    """The facts of a file's head that reading depends on.

    Attributes:
        is_own: whether this package wrote the file.
        units: the unit of its lengths, as it says; None if it says nothing.
        first_pixel: see Convention, of a file of this package; None of others.
    """

    is_own: bool
    units: str | None
    first_pixel: float | None

    def convention(self) -> Convention:
        """OMNI3D, with the pixel origin that the file states if this package wrote it."""
        if self.first_pixel is None:
            return OMNI3D
        return replace(OMNI3D, first_pixel=self.first_pixel)

    def is_metric(self, of_box: bool | None, metric: Metric) -> bool:
        """Whether the lengths of a box are metres.

        Args:
            of_box: the box's own key "metric", which only files of this package have.
            metric: what the user knows; "info": as the file says, and if it is not of this package
                and says nothing, it is not known.

        """
        if metric != "info":
            return metric == "yes"
        if self.is_own and of_box is not None:
            return of_box
        return self.is_own if self.units is None else self.units.strip().lower() in METRES

    def unit_note(self, metric: Metric) -> tuple[str, ...]:
        """A sentence on lengths of which it is not known that they are metres, if so."""
        if metric != "info" or self.is_own or self.is_metric(None, metric):
            return ()
        said = "does not say" if self.units is None else f"says is {self.units!r}"
        return (
            f"lengths are in a unit that the file {said} (info.units), so scale is not known; if"
            " they are metres, say so (metric='yes', --metric yes)",
        )


def stated_head(raw: msgspec.Raw) -> StatedHead:
    """The head of a file; of one that is no dictionary, as Omni3D's lists are not, nothing."""
    try:
        info: dict[str, Any] = msgspec.json.decode(raw, type=dict[str, Any])
    except msgspec.ValidationError:
        info = {}
    is_own = info.get("generator") == GENERATOR
    units, first_pixel = info.get("units"), info.get("first_pixel")
    return StatedHead(
        is_own=is_own,
        units=units if isinstance(units, str) else None,
        first_pixel=float(first_pixel) if is_own and isinstance(first_pixel, int | float) else None,
    )
