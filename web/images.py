"""What a robot in the page sees and aims at, in tensors alone, for its graphs.

Python itself leaves colour, closing, opening and distances to OpenCV, which a graph
can't hold.
"""

import torch
from torch import Tensor

from clothlab.method.autoencoder import Autoencoder

HEIGHT, WIDTH = 96, 128  # of the camera's image [pixel]
# Red beyond green and blue by more of 255 is cloth; gaps and slivers of such a size go
_REDNESS = 40
_KERNEL = ((0, 0, 1, 0, 0), *[(1, 1, 1, 1, 1)] * 3, (0, 0, 1, 0, 0))
# IoU with its reconstruction below which an image is not drawn
_CANNOT_DRAW = 0.6

# Of a pixel, where OpenGL has its four: sixteen in a grid close gaps behind the arm
# that a real picture leaves open.
SAMPLES = ((0.375, 0.875), (0.875, 0.625), (0.125, 0.375), (0.625, 0.125))


class Images:
    """Images as an autoencoder knows them.

    Args:
        autoencoder: a trained one.
    """

    def __init__(self, autoencoder: Autoencoder):
        self._autoencoder = autoencoder

    def see(self, green: Tensor, blue: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Of a picture, the mask `[H, W]`, its z `[D_z]`, and what that says of it.

        Each pixel has samples: how much more red they are than green, and than blue
        `[H, W, S]`.
        """
        redness = torch.minimum(green.mean(-1), blue.mean(-1))
        mask = (redness > _REDNESS).float()
        closed = _eroded(_dilated(mask))
        opened = _dilated(_eroded(closed))
        z = self._encode(opened)
        return opened.to(torch.uint8), z, self._decode(z)

    def aim(self, image: Tensor, images: Tensor) -> tuple[Tensor, ...]:
        """What is aimed at, as `aim_at` has it: `known` to `overlap` of an `Aim`.

        From a target `[H, W]` that is not empty, and recorded images `[N, H, W]`.
        """
        # The target as the network knows it
        z = self._encode(image)
        reconstruction = self._decode(z)
        drawn = (reconstruction > 0.5).float()
        distance = chamfer_distance(image, drawn)
        distance = torch.where(drawn.sum() > 0, distance, torch.inf)

        # A recorded image in its place
        own = _iou(drawn[None], image)[0]
        overlaps = _iou(images, image)
        overlap = overlaps.amax(0)
        nearest = images.index_select(0, overlaps.argmax(0, keepdim=True))[0]
        replaced = (own < _CANNOT_DRAW) & (overlap > own)
        known = torch.where(replaced, nearest, image)
        z = self._encode(known)
        return known.to(torch.uint8), z, reconstruction, distance, overlap

    def _encode(self, image: Tensor) -> Tensor:
        return self._autoencoder.encoder(image[None, None])[0]

    def _decode(self, z: Tensor) -> Tensor:
        return self._autoencoder.decoder(z[None]).sigmoid()[0, 0]


def _dilated(mask: Tensor) -> Tensor:
    """What lies within the kernel of any pixel of a mask `[H, W]` of 0 and 1."""
    kernel = torch.tensor(_KERNEL, dtype=mask.dtype)[None, None]
    around = torch.nn.functional.conv2d(mask[None, None], kernel, padding="same")
    return (around[0, 0] > 0.5).to(mask.dtype)


def _eroded(mask: Tensor) -> Tensor:
    """What is left if all that is no cloth grows so; outside there is none of it."""
    return 1 - _dilated(1 - mask)


def _iou(masks: Tensor, other: Tensor) -> Tensor:
    """IoU `[N]` of masks `[N, H, W]` with another that has cloth, `[H, W]`."""
    common = (masks * other).sum((1, 2))
    return common / (masks.sum((1, 2)) + other.sum() - common)


def chamfer_distance(a: Tensor, b: Tensor) -> Tensor:
    """Mean distance from one mask `[H, W]` to the other, both ways [pixel]."""
    from_a = (a * _distance_to(b)).sum() / a.sum()
    from_b = (b * _distance_to(a)).sum() / b.sum()
    return (from_a + from_b) / 2


def _distance_to(mask: Tensor) -> Tensor:
    """Distance [pixel] of every pixel to the nearest one of a mask, `[H, W]`."""
    # First within columns, then of all columns
    rows, columns = (torch.arange(size, dtype=mask.dtype) for size in mask.shape)
    outside = torch.where(mask > 0.5, 0.0, torch.inf)
    squares = ((rows[:, None] - rows) ** 2)[:, :, None] + outside
    nearest = squares.amin(1)
    squares = nearest[:, None] + (columns[:, None] - columns) ** 2
    return squares.amin(2).sqrt()
