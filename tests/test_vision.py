"""From picture to mask, and the chamfer distance."""

import cv2
import numpy as np
import pytest

from clothlab.autoencoder import iou
from clothlab.vision import chamfer_distance, cloth_mask


def project(env, points):
    """Pixel coordinates of points in the world, `[N, 3]` → `[N, 2]`, by the pinhole model."""
    camera = env.data.camera("camera")
    local = (points - camera.xpos) @ camera.xmat.reshape(3, 3)
    focal = 48 / np.tan(np.deg2rad(env.arm.camera.fovy / 2))
    return np.stack([64 + focal * local[:, 0] / -local[:, 2], 48 - focal * local[:, 1] / -local[:, 2]], axis=1)


def test_mask_of_a_rendered_cloth_matches_the_projected_points(env):
    observation, _ = env.reset()
    points = env.cloth_points()
    outline = np.concatenate([points[0], points[1:, -1], points[-1, -2::-1], points[-2:0:-1, 0]])
    fine = np.zeros((960, 1280), np.uint8)  # ten times as fine, because a polygon's border takes a whole pixel
    cv2.fillPoly(fine, [np.round(10 * project(env, outline)).astype(np.int32)], 255)
    expected = cv2.resize(fine, (128, 96), interpolation=cv2.INTER_AREA) > 127
    assert iou(observation["image"], expected) > 0.9


def test_only_the_red_front_is_seen():
    picture = np.full((96, 128, 3), 128, np.uint8)
    picture[20:40, 20:40] = (200, 30, 40)
    picture[20:40, 60:80] = (25, 60, 165)
    mask = cloth_mask(picture)
    assert mask[22:38, 22:38].all()
    assert not mask[:, 50:].any()


def test_specks_and_pinholes_are_cleaned():
    picture = np.full((96, 128, 3), 128, np.uint8)
    picture[20:40, 20:40] = (200, 30, 40)
    picture[30, 30] = 128  # a pinhole
    picture[70, 100] = (200, 30, 40)  # a speck
    mask = cloth_mask(picture)
    assert mask[30, 30]
    assert not mask[70, 100]


def test_a_larger_picture_gives_the_same_mask():
    small = np.full((96, 128, 3), 128, np.uint8)
    small[20:60, 20:70] = (200, 30, 40)
    large = small.repeat(3, axis=0).repeat(3, axis=1)
    assert (cloth_mask(small) == cloth_mask(large)).mean() > 0.999


def test_chamfer_is_zero_on_equals_and_symmetric(square):
    other = np.roll(square, (7, -9), axis=(0, 1))
    assert chamfer_distance(square, square) == 0
    assert chamfer_distance(square, other) == pytest.approx(chamfer_distance(other, square))
    assert chamfer_distance(square, other) > 0


def test_chamfer_of_two_points_is_their_distance():
    a, b = np.zeros((2, 96, 128), bool)
    a[10, 10], b[13, 14] = True, True
    assert chamfer_distance(a, b) == pytest.approx(5.0)


def test_chamfer_grows_with_the_shift(square):
    distances = [chamfer_distance(square, np.roll(square, k, axis=1)) for k in range(0, 40, 5)]
    assert (np.diff(distances) > 0).all()


def test_bad_images_are_refused(square):
    with pytest.raises(ValueError, match="no cloth in the image"):
        chamfer_distance(square, np.zeros((96, 128), bool))
    with pytest.raises(ValueError, match=r"shape \(96, 128\), got \(48, 64\)"):
        chamfer_distance(square, square[::2, ::2])
    with pytest.raises(ValueError, match="aspect 4:3"):
        cloth_mask(np.zeros((96, 96, 3), np.uint8))
    with pytest.raises(ValueError, match="uint8"):
        cloth_mask(np.zeros((96, 128, 3)))
