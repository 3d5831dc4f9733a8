"""Counts in sentences: "1 image", "2 images"."""


def counted(count: int, noun: str, plural: str | None = None) -> str:
    """A count with its noun, for the lines that commands print.

    Args:
        count: how many.
        noun: for one of them.
        plural: for any other number; None: the noun with an s.

    Example:
        >>> counted(1, "image"), counted(0, "image"), counted(2, "box", "boxes")
        ('1 image', '0 images', '2 boxes')
    """
    return f"{count} {noun if count == 1 else plural or f'{noun}s'}"
