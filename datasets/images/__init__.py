"""Pixels: photographs, EXIF headers, masks as pictures and as runs."""
