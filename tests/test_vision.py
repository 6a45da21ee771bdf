"""From picture to mask, and the chamfer distance."""

import cv2
import numpy as np
import pytest

from clothlab._validation import check_mask, check_masks
from clothlab.simulation.vision import chamfer_distance, cloth_mask, iou, mask_from_file

RED, BLUE, GREY = (200, 30, 40), (25, 60, 165), (128, 128, 128)


def picture(*patches, colour=RED) -> np.ndarray:
    """A grey picture with patches of a colour."""
    picture = np.full((96, 128, 3), GREY, np.uint8)
    for rows, columns in patches:
        picture[rows, columns] = colour
    return picture


def project(env, points):
    """Pixel coordinates of points in the world, `[N, 3]` → `[N, 2]`, by the pinhole
    model.
    """
    camera = env.data.camera("camera")
    local = (points - camera.xpos) @ camera.xmat.reshape(3, 3)
    focal = 48 / np.tan(np.deg2rad(env.arm.camera.fovy / 2))
    return np.stack(
        [
            64 + focal * local[:, 0] / -local[:, 2],
            48 - focal * local[:, 1] / -local[:, 2],
        ],
        axis=1,
    )


def test_mask_of_a_rendered_cloth_matches_the_projected_points(env):
    points = env.cloth_points()
    outline = np.concatenate(
        [points[0], points[1:, -1], points[-1, -2::-1], points[-2:0:-1, 0]]
    )
    # Ten times as fine, because a polygon's border takes a whole pixel
    fine = np.zeros((960, 1280), np.uint8)
    cv2.fillPoly(fine, [np.round(10 * project(env, outline)).astype(np.int32)], 255)
    expected = cv2.resize(fine, (128, 96), interpolation=cv2.INTER_AREA) > 127
    assert iou(env.observe()["image"], expected) > 0.9


def test_only_the_red_front_is_seen():
    both = picture((slice(20, 40), slice(20, 40)))
    both[20:40, 60:80] = BLUE
    mask = cloth_mask(both)
    assert mask.dtype == bool
    assert mask[22:38, 22:38].all()
    assert not mask[:, 50:].any()


def test_specks_and_pinholes_are_cleaned():
    spotted = picture((slice(20, 40), slice(20, 40)), (70, 100))
    spotted[30, 30] = GREY
    mask = cloth_mask(spotted)
    assert mask[30, 30]
    assert not mask[70, 100]


def test_a_larger_picture_gives_the_same_mask():
    small = picture((slice(20, 60), slice(20, 70)))
    large = small.repeat(3, axis=0).repeat(3, axis=1)
    assert (cloth_mask(small) == cloth_mask(large)).mean() > 0.999


def test_chamfer_is_zero_on_equals_and_symmetric(square):
    other = np.roll(square, (7, -9), axis=(0, 1))
    assert chamfer_distance(square, square) == 0
    assert chamfer_distance(square, other) == pytest.approx(
        chamfer_distance(other, square)
    )
    assert chamfer_distance(square, other) > 0


def test_chamfer_of_two_points_is_their_distance():
    a, b = np.zeros((2, 96, 128), bool)
    a[10, 10], b[13, 14] = True, True
    assert chamfer_distance(a, b) == pytest.approx(5.0)


def test_chamfer_grows_with_the_shift(square):
    distances = [
        chamfer_distance(square, np.roll(square, k, axis=1)) for k in range(0, 40, 5)
    ]
    assert (np.diff(distances) > 0).all()


@pytest.mark.parametrize(
    "kind", [bool, np.int8, np.uint8, np.int64, np.float32, np.float64]
)
def test_zero_and_one_are_a_mask_in_whatever_type(square, kind):
    assert np.array_equal(check_masks(square.astype(kind)), square)
    assert chamfer_distance(square.astype(kind), square) == 0


@pytest.mark.parametrize("use", [iou, chamfer_distance])
def test_an_image_of_another_kind_or_size_is_no_mask(square, use):
    with pytest.raises(
        ValueError,
        match=r"holds 0 and 1 only: `picture > 127` makes one of a grey picture, `image > 0.5`",
    ):
        use(square * np.uint8(255), square)
    with pytest.raises(
        ValueError, match=r"cloth images are \[..., 96, 128\], got the shape \["
    ):
        use(square.T, square)


def test_one_mask_is_one_and_shows_cloth(square):
    with pytest.raises(
        ValueError,
        match=r"one cloth image is \[96, 128\], got the shape \[2, 96, 128\]",
    ):
        check_mask(np.stack([square, square]))
    with pytest.raises(ValueError, match="no cloth in the image"):
        chamfer_distance(square, ~square & False)


def test_a_picture_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="aspect 4:3, got 96×96; crop it first"):
        cloth_mask(np.zeros((96, 96, 3), np.uint8))


def test_targets_come_from_picture_files(square):
    _, png = cv2.imencode(".png", square.astype(np.uint8) * 255)
    assert np.array_equal(mask_from_file(png.tobytes()), square)
    _, small = cv2.imencode(".png", np.full((10, 10), 255, np.uint8))
    for content, message in (
        (b"no picture", "not a picture"),
        (b"", "not a picture"),
        (small.tobytes(), "10×10"),
    ):
        with pytest.raises(ValueError, match=message):
            mask_from_file(content)


def test_a_grey_target_is_cloth_where_it_is_brighter_than_half():
    grey = np.full((96, 128), 127, np.uint8)
    grey[10:20, 30:50] = 128
    file = cv2.imencode(".png", grey)[1].tobytes()
    assert np.array_equal(mask_from_file(file), grey == 128)
