"""When, where and of whom a picture is, as far as its dataset's file says.

No label needs it; whoever counts animals by labels does. Positions and owners in a picture's own
header are never read: only what somebody wrote into the dataset's file travels.
"""

import math
from operator import attrgetter
from typing import Any

import msgspec

LONGEST = 200
"""Letters of a value that are kept."""


class Sighting(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """When, where and of whom a picture is; None of what nobody says.

    Attributes:
        time: as the file says it, else of the picture's EXIF header, local time in ISO 8601.
        sequence: the burst, video or track of pictures that it belongs to.
        individual: the animal itself, where somebody knows it.
        track: the animal from frame to frame of one sequence.
        place: of the camera; only if the user keeps places (`keep=("location",)`).

    Example:
        >>> Sighting(individual="Nala").known
        {'individual': 'Nala'}
    """

    time: str | None = None
    sequence: str | None = None
    individual: str | None = None
    track: str | None = None
    place: str | None = None

    @property
    def known(self) -> dict[str, str]:
        """The fields that have a value, name -> value, as targets and labels.json hold them."""
        values = {name: getattr(self, name) for name in SIGHTING_FIELDS}
        return {name: value for name, value in values.items() if value is not None}

    def with_picture_time(self, time: str | None) -> "Sighting":
        """The same, with the time of the picture's own header where the file says none."""
        if self.time is not None or time is None:
            return self
        return msgspec.structs.replace(self, time=time)

    def without_place(self) -> "Sighting":
        """The same, wherever it was."""
        return self if self.place is None else msgspec.structs.replace(self, place=None)


SIGHTING_FIELDS = Sighting.__struct_fields__
"""The names of what may be known, in the order of the columns of labels.csv."""
NO_SIGHTING = Sighting()
"""Nothing is known."""


class SightingKeys(msgspec.Struct, kw_only=True, gc=False):
    """The keys of an image's or an animal's JSON element that say when, where and of whom it is.

    Readers' elements inherit them. A value of any form is accepted: what is neither text nor a
    number says nothing, and spoils nothing.
    """

    datetime: Any = None
    date_time: Any = None
    date_captured: Any = None
    timestamp: Any = None
    time: Any = None
    seq_id: Any = None
    sequence_id: Any = None
    sequence: Any = None
    video_id: Any = None
    individual_id: Any = None
    individual: Any = None
    identity: Any = None
    animal_id: Any = None
    track_id: Any = None
    tracklet_id: Any = None
    location: Any = None
    place: Any = None
    site: Any = None
    station: Any = None
    deployment_id: Any = None


NO_KEYS = SightingKeys()
"""An element that says nothing."""
KEYS = {
    "time": ("datetime", "date_time", "date_captured", "timestamp", "time"),
    "sequence": ("seq_id", "sequence_id", "sequence", "video_id"),
    "individual": ("individual_id", "individual", "identity", "animal_id"),
    "track": ("track_id", "tracklet_id"),
    "place": ("location", "place", "site", "station", "deployment_id"),
}
"""What a sighting holds -> the keys that say it, first come first served."""
_FIELDS = tuple(field for field, keys in KEYS.items() for _ in keys)
"""What each key says, in the order of _VALUES."""
_VALUES = attrgetter(*(key for keys in KEYS.values() for key in keys))
_NOTHING = _VALUES(NO_KEYS)


def is_silent(element: SightingKeys) -> bool:
    """Whether an element of a file says nothing of when, where and of whom a picture is."""
    silent: bool = _VALUES(element) == _NOTHING
    return silent


def sighting_of(element: SightingKeys, image: Sighting = NO_SIGHTING) -> Sighting:
    """What an element of a file says of a picture, and what its image says beside it.

    Args:
        element: of an image, or of an animal in it.
        image: what the animal's image says, which holds where the animal says nothing.

    Example:
        >>> image = sighting_of(SightingKeys(datetime="2024-05-01 06:10:00"))
        >>> sighting_of(SightingKeys(track_id=7), image).known
        {'time': '2024-05-01 06:10:00', 'track': '7'}
    """
    values = _VALUES(element)
    if values == _NOTHING:  # as in most files
        return image
    known: dict[str, str] = {}
    for field, value in zip(_FIELDS, values, strict=True):
        text = None if value is None or field in known else _text(value)
        if text is not None:
            known[field] = text
    return msgspec.structs.replace(image, **known) if known else image


def _text(value: object) -> str | None:
    """A value as one line of text; None if it says nothing."""
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        value = int(value) if value.is_integer() else value  # as tables of floats write them
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return None
    return " ".join(str(value).split())[:LONGEST] or None
