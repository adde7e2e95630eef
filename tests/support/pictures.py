"""Search for a known colour in a picture."""

import numpy as np


def where(picture, colour, angle=0.25):
    """Return the pixels (height, width) with this hue, lit or shaded, as booleans."""
    pixels = picture.reshape(-1, 3).astype(float)
    wanted = np.array(colour, dtype=float)
    length = np.linalg.norm(pixels, axis=1)
    cosine = pixels @ wanted / np.maximum(length * np.linalg.norm(wanted), 1e-9)
    bright = length > 0.25 * np.linalg.norm(wanted)
    dark = length < 1.4 * np.linalg.norm(wanted)
    return ((cosine > np.cos(angle)) & bright & dark).reshape(picture.shape[:2])


def middle_of(picture, colour, **how):
    """Return the mean column and row of the pixels with this hue."""
    found = np.argwhere(where(picture, colour, **how))
    assert len(found) > 5, f"nothing of colour {colour} in the picture"
    row, column = found.mean(axis=0)
    return float(column), float(row)
