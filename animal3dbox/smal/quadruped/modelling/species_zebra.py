"""A zebra: a stocky horse with a rounder barrel, a brush of an upright mane, rounder ears.

And a tasselled tail.
"""

import numpy as np

from animal3dbox.smal.quadruped.modelling.species_horse import HORSE_ROWS

ZEBRA_ROWS = {
    **HORSE_ROWS,
    # x, top, bottom, half width
    "trunk": (
        (-0.485, 0.865, 0.67, 0.09),
        (-0.41, 0.94, 0.58, 0.155),
        (-0.26, 0.975, 0.515, 0.18),
        (-0.06, 0.95, 0.475, 0.19),
        (0.12, 0.945, 0.465, 0.19),
        (0.25, 0.97, 0.475, 0.17),
        (0.37, 0.965, 0.51, 0.14),
        (0.47, 0.845, 0.57, 0.105),
    ),
    # x, z, half sizes through and across
    "neck": (
        (0.36, 0.79, 0.2, 0.1),
        (0.475, 0.9, 0.168, 0.086),
        (0.575, 1.015, 0.138, 0.074),
        (0.65, 1.11, 0.112, 0.067),
    ),
    "head_frame": (0.65, 1.185, -50.0, 0.43),  # x, z, pitch in degrees, length
    "tail": (
        (-0.43, 0.875, 0.045, 0.045),
        (-0.5, 0.855, 0.032, 0.032),
        (-0.545, 0.78, 0.027, 0.027),
        (-0.562, 0.69, 0.026, 0.026),
        (-0.57, 0.59, 0.026, 0.026),
        (-0.573, 0.49, 0.036, 0.034),
        (-0.573, 0.385, 0.043, 0.04),
        (-0.573, 0.27, 0.01, 0.01),
    ),
    # u, y, w, half width, half thickness, in head lengths
    "ear": (
        (0.11, 0.085, 0.115, 0.06, 0.04),
        (0.085, 0.11, 0.215, 0.085, 0.034),
        (0.055, 0.125, 0.325, 0.078, 0.03),
        (0.03, 0.12, 0.41, 0.035, 0.022),
    ),
    # along the crest: x, z, half sizes through and across
    "mane": (
        (0.36, 0.985, 0.065, 0.021),
        (0.455, 1.085, 0.075, 0.021),
        (0.545, 1.18, 0.076, 0.021),
        (0.635, 1.275, 0.05, 0.02),
    ),
    "belly": (-0.02, 0.0, 0.63, 0.225, 0.165, 0.145, 0.0),
}

ZEBRA = {name: np.asarray(rows, dtype=np.float64) for name, rows in ZEBRA_ROWS.items()}
