"""The preset of the quadruped that is nearest to an animal's category."""

from types import MappingProxyType

from animal3dbox.errors import ConfigError
from animal3dbox.smal.quadruped.preset_bodies import quadruped_names

AUTO, UNKNOWN = "auto", "unknown"
"""Species by the dataset's category, and of no animal."""
CATEGORIES = MappingProxyType(
    {
        "dog": ("dog", "wolf", "fox", "coyote", "jackal", "dingo", "hyena"),
        "cat": ("cat", "bobcat", "lynx", "ocelot", "serval"),
        "lion": (
            *("lion", "tiger", "jaguar", "leopard", "cheetah", "panther", "puma", "cougar"),
            "lioness",
        ),
        "horse": ("horse", "pony", "donkey", "mule"),
        "zebra": ("zebra",),
        "cow": ("cow", "cattle", "bull", "ox", "bison", "buffalo", "yak"),
        "deer": ("deer", "antelope", "gazelle", "impala", "elk", "moose", "reindeer"),
        "pig": ("pig", "boar", "warthog", "hog"),
        "bear": ("bear", "panda"),
        "hippo": ("hippo", "hippopotamus"),
    }
)
"""Preset -> the words by which datasets call animals that are built like it."""
NOT_THESE = frozenset({"sea lion", "guinea pig", "raccoon dog", "prairie dog", "red panda"})
"""Categories whose last word misleads."""
_PRESET_OF_WORD = {word: preset for preset, words in CATEGORIES.items() for word in words}


def preset_of_category(category: str | None) -> str | None:
    """The preset of a category, by all of its words or the last; None if there is none.

    Example:
        >>> [preset_of_category(name) for name in ("Snow_Leopard", "polar bear", "sea lion")]
        ['lion', 'bear', None]
    """
    words = (category or "").lower().replace("_", " ").replace("-", " ").split()
    if not words or " ".join(words) in NOT_THESE:
        return None
    return _PRESET_OF_WORD.get(" ".join(words), _PRESET_OF_WORD.get(words[-1]))


def check_species(species: str) -> None:
    """Raise a ConfigError for a species that is neither a preset, nor "auto" or "unknown"."""
    choices = (AUTO, UNKNOWN, *quadruped_names().presets)
    if species not in choices:
        raise ConfigError(f"species must be one of {', '.join(choices)}, got {species!r}")
