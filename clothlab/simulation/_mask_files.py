"""Pictures of targets: a cloth mask from a file."""

import io

import numpy as np
from PIL import Image

from clothlab._validation import HEIGHT, WIDTH, check_mask


def mask_from_file(content: bytes) -> np.ndarray:
    """Read a target `[H, W]` from a PNG or JPEG file of that size: bright is cloth."""
    try:
        with Image.open(io.BytesIO(content), formats=["PNG", "JPEG"]) as picture:
            size = picture.size
            grey = np.asarray(picture.convert("L")) if size == (WIDTH, HEIGHT) else None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        # What Pillow says of a damaged file
        raise ValueError("this file is not a picture: use PNG or JPEG") from None
    if grey is None:
        raise ValueError(
            f"a target has {WIDTH}×{HEIGHT} pixels, this picture {size[0]}×{size[1]}"
        )
    return check_mask(grey > 127)
