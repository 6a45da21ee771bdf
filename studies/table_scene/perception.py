"""Coloured point clouds, and the cloth, the basket and the bar in the hand in them.

The paper recognises cloth and basket in point clouds, and does not say how ("Integrated
Table Setting Experiment"). Here colour chooses points, DBSCAN the ones that hang
together (a pixel on an outline has the colour of a thing and the depth of what is
behind), and poses are fitted to them. What is not in view as a whole is a
`NotVisibleError`.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from sklearn.cluster import DBSCAN
from sklearn.linear_model import RANSACRegressor

from clothlab._validation import check_number
from clothlab.simulation.arm import BAR_RADIUS
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import ClothEnv
from clothlab.simulation.vision import focal_length
from studies.table_scene.scene import Basket
from studies.table_scene.table_env import ClothPose

_HEIGHT = (
    480  # [pixel] of a depth image, whose aspect is 4:3: at 1 m a pixel is 3 mm wide
)
_FARTHEST = 3.0  # [m] what is farther away is of no use to the arm
_FEWEST = 150  # points of a thing; fewer are a scrap of it
_HUE = 40  # of 255, by which a colour must stand out, as in `vision.cloth_mask`
# Of 255, by which red and green stand out from blue in the basket's colour, not in
# wood's
_YELLOW = 60
_DARK = 75  # of 255: only the bar is darker in every colour
_CELL = 0.01  # [m] of the coarse grid in which clusters are looked for
_LINK = 0.025  # [m] points nearer than that hang together
_BIN = 0.01  # [m] of the cloth's width, each of which has its uppermost point
_LEAST_WIDTH = 0.10  # [m] of an edge that can be told from a scrap
# [m] of the grid by which an area is measured: no pixel of it is as large, seen at a
# slant
_AREA_CELL = 0.02
_ON_TOP = 0.02  # [m] above a table or below, what seems to lie on it
# Of 255, by which blue stands out from green on a cloth's red back, not on its front
_BACK = 14
_BAR_WITHIN = 0.30  # [m] of where the hand should be
_ROD_SLACK = 0.02  # [m] above and below the rod, what still belongs to it


class NotVisibleError(RuntimeError):
    """What was looked for is not to be seen, or not enough of it."""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Coloured points in the world, as one camera saw them."""

    points: np.ndarray  # `[N, 3]` [m]
    colours: np.ndarray  # red, green, blue `[N, 3]`, uint8
    # Which of them are not at the picture's border, where things are cut off `[N]`,
    # bool
    inside: np.ndarray
    camera: np.ndarray  # where the camera is `[3]` [m]

    def __len__(self) -> int:
        """The number of points N."""
        return len(self.points)

    def __getitem__(self, index: np.ndarray | slice) -> "PointCloud":
        """Some of the points."""
        return PointCloud(
            self.points[index], self.colours[index], self.inside[index], self.camera
        )


def depth_picture(env: ClothEnv, height: int = _HEIGHT) -> np.ndarray:
    """How far each pixel's surface is from the camera, along its line of sight's axis
    `[height, height * 4/3]` [m].
    """
    return env.camera_picture(height, height * 4 // 3, depth=True).astype(np.float64)


def capture_point_cloud(
    env: ClothEnv,
    height: int = _HEIGHT,
    *,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> PointCloud:
    """Take a coloured point cloud with the scene's camera, of all that is nearer than 3
    m; `height` [pixel].

    `noise` is the standard deviation of a pixel's depth at 1 m [m], and grows with the
    square of the distance, as that of stereo cameras does; `rng` draws it.
    """
    depth, colours = (
        depth_picture(env, height),
        env.camera_picture(height, height * 4 // 3),
    )
    if check_number("noise", noise, at_least=0):
        if rng is None:
            raise ValueError(
                "a noisy depth image needs an rng: numpy.random.default_rng(seed)"
            )
        depth += rng.normal(0.0, noise, depth.shape) * depth**2
    camera, fovy = env.data.camera("camera"), float(env.model.camera("camera").fovy[0])
    points = _depth_points(depth, fovy, camera.xpos, camera.xmat.reshape(3, 3).T)
    inside = np.zeros(depth.shape, bool)
    inside[2:-2, 2:-2] = True
    near = depth < _FARTHEST
    return PointCloud(points[near], colours[near], inside[near], camera.xpos.copy())


def _depth_points(
    depth: np.ndarray, fovy: float, position: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """Where in the world the pixels of a depth image `[h, w]` [m] are, `[h, w, 3]` [m]:
    a pinhole camera, backwards.
    """
    height, width = depth.shape
    focal = focal_length(fovy, height)  # [pixel]
    right = (np.arange(width) + 0.5 - width / 2) / focal
    up = -(np.arange(height) + 0.5 - height / 2) / focal
    rays = np.stack(
        [*np.broadcast_arrays(right, up[:, None]), -np.ones((height, width))], axis=-1
    )
    return position + depth[..., None] * (rays @ axes)


def find_cloth_edge(cloud: PointCloud) -> np.ndarray:
    """Find the ends of a hanging cloth's upper edge, to the robot's right and left `[2,
    3]` [m], by a robust line.
    """
    cloth = _largest_cluster("cloth", cloud, _cloth_coloured(cloud.colours))
    y, z = cloth.points[:, 1:].T
    bins = np.floor((y - y.min()) / _BIN).astype(int)
    order = np.lexsort((-z, bins))
    top = order[np.unique(bins[order], return_index=True)[1]]
    if len(top) * _BIN < _LEAST_WIDTH:
        raise NotVisibleError(
            f"only {100 * len(top) * _BIN:.0f} cm of the cloth's edge are in view: look from elsewhere"
        )
    line = RANSACRegressor(residual_threshold=_BIN, random_state=0).fit(
        y[top, None], cloth.points[top][:, [0, 2]]
    )
    on_edge = top[line.inlier_mask_]
    if np.mean(cloth.inside[on_edge]) < 0.9:
        raise NotVisibleError(
            "the cloth's upper edge is cut off by the picture: look from farther away"
        )
    ends = np.array([y[on_edge].min(), y[on_edge].max()])
    along = line.predict(ends[:, None])
    return np.column_stack([along[:, 0], ends, along[:, 1]])


def find_cloth_pose(cloud: PointCloud, height: float, cloth: Cloth) -> ClothPose:
    """Find how a cloth lies on a table of that height [m]."""
    seen = _largest_cluster("cloth", cloud, _cloth_coloured(cloud.colours))
    level = np.abs(seen.points[:, 2] - height) < _ON_TOP
    cells = np.unique(np.floor(seen.points[level, :2] / _AREA_CELL), axis=0)
    if len(cells) < 4:
        return ClothPose(0.0, 0.0, 0.0, seen.points.mean(axis=0), back_up=False)
    centre, size, angle = cv2.minAreaRect(seen.points[level][:, :2].astype(np.float32))
    # The cells at the outline are covered by half on average.
    area = (len(cells) * _AREA_CELL**2 - sum(size) * _AREA_CELL) / (
        cloth.length * cloth.width
    )
    _, green, blue = np.median(seen.colours[level].astype(int), axis=0)
    turned = (angle + 45.0) % 90.0 - 45.0
    place = np.array([*centre, seen.points[level, 2].mean()])
    return ClothPose(
        float(level.mean()),
        float(area),
        turned,
        place,
        back_up=bool(blue - green > _BACK),
    )


def find_cloth_centre(cloud: PointCloud, height: float) -> np.ndarray:
    """Find the middle `[3]` [m] of the rectangle around a cloth that lies on a table of
    that height [m].
    """
    level = np.abs(cloud.points[:, 2] - height) < _LINK
    cloth = _largest_cluster(
        "cloth on the table", cloud, level & _cloth_coloured(cloud.colours)
    )
    centre, _, _ = cv2.minAreaRect(cloth.points[:, :2].astype(np.float32))
    return np.array([*centre, cloth.points[:, 2].mean()])


def find_basket(cloud: PointCloud) -> tuple[np.ndarray, float]:
    """Find the middle of an upright basket's bottom `[3]` [m], and its turn from above,
    -90 to 90 [degree].

    By least squares between points and surface: in 24 places, with noise of 2 mm at 1
    m, off by 0.3 mm and 0.15° at most (`cv2.minAreaRect` of the rim and the median
    height of the rod: 5.3 mm and 0.43°).
    """
    red, green, blue = cloud.colours.astype(int).T
    basket = _largest_cluster("basket", cloud, np.minimum(red, green) - blue > _YELLOW)
    if np.mean(basket.inside) < 0.99:
        raise NotVisibleError(
            "the basket is cut off by the picture: look from farther away"
        )
    points = basket.points[:: max(1, len(basket) // 1500)]
    middle = np.append(
        np.median(points[:, :2], axis=0), points[:, 2].max() - Basket.handle_height
    )

    def distance(pose: np.ndarray) -> np.ndarray:
        return _basket_distance(points, pose[:3], pose[3])

    starts = [np.append(middle, turn) for turn in np.deg2rad([-60, -20, 20, 60])]
    best = min(
        (least_squares(distance, x, loss="soft_l1", f_scale=0.005) for x in starts),
        key=lambda fit: fit.cost,
    )
    bottom, turn = best.x[:3], (best.x[3] + np.pi / 2) % np.pi - np.pi / 2
    rod = np.abs(basket.points[:, 2] - (bottom[2] + Basket.handle_height)) < _ROD_SLACK
    if rod.sum() < _FEWEST / 10:
        raise NotVisibleError("the basket's handle is hidden: look from elsewhere")
    return bottom, float(np.rad2deg(turn))


def find_bar(cloud: PointCloud, near: ArrayLike) -> np.ndarray:
    """Find the middle of the bar in the hand `[3]` [m], `near` where it should be: dark
    elsewhere is the shade.
    """
    dark = (cloud.colours < _DARK).all(axis=1)
    bar = cloud[dark & (np.linalg.norm(cloud.points - near, axis=1) < _BAR_WITHIN)]
    if len(bar) < _FEWEST / 3 or np.ptp(bar.points[:, 1]) < _LEAST_WIDTH:
        raise NotVisibleError("the bar is not in view where the hand should be")
    # The camera sees the near side of a round bar; its axis lies behind, a little less
    # than a radius on average.
    behind = bar.points - cloud.camera
    axis = (
        bar.points
        + behind
        / np.linalg.norm(behind, axis=1, keepdims=True)
        * BAR_RADIUS
        * np.pi
        / 4
    )
    good = (
        np.linalg.norm(axis[:, [0, 2]] - np.median(axis[:, [0, 2]], axis=0), axis=1)
        < 2 * _LINK
    )
    forward, up = np.median(axis[good][:, [0, 2]], axis=0)
    return np.array([forward, np.mean([axis[good, 1].min(), axis[good, 1].max()]), up])


def _basket_distance(points: np.ndarray, bottom: np.ndarray, turn: float) -> np.ndarray:
    """How far points `[N, 3]` [m] are outside the surface of a basket turned by `turn`
    [rad], negative inside `[N]`.
    """
    cos, sin = np.cos(turn), np.sin(turn)
    local = (points - bottom) @ np.array(
        [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
    )
    half = np.array(Basket.size) / 2
    beyond = np.abs(local - [0.0, 0.0, half[2]]) - half
    box = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(
        beyond.max(axis=1), 0.0
    )
    side, top = Basket.handle_width / 2, Basket.handle_height
    # Nearest points on the rod, and on the leg of the same side.
    _, y, z = local.T
    rod = np.column_stack(
        [np.zeros_like(y), np.clip(y, -side, side), np.full_like(y, top)]
    )
    leg = np.column_stack(
        [
            np.zeros_like(y),
            np.where(y < 0, -side, side),
            np.clip(z, Basket.size[2], top),
        ]
    )
    handle = np.minimum(
        *(np.linalg.norm(local - nearest, axis=1) for nearest in (rod, leg))
    )
    return np.minimum(box, handle - Basket.handle_radius)


def _cloth_coloured(colours: np.ndarray) -> np.ndarray:
    """Whether they may be the cloth's: its red front or its blue back `[N]`, bool."""
    red, green, blue = colours.astype(int).T
    return (red - np.maximum(green, blue) > _HUE) | (
        blue - np.maximum(red, green) > _HUE
    )


def _largest_cluster(name: str, cloud: PointCloud, coloured: np.ndarray) -> PointCloud:
    """The largest part of the coloured points that hangs together."""
    subset = cloud[coloured]
    if len(subset) < _FEWEST:
        raise NotVisibleError(
            f"no {name} in view: {len(subset)} points have its colour, {_FEWEST} are needed"
        )
    cells, cell_of = np.unique(
        np.floor(subset.points / _CELL).astype(int), axis=0, return_inverse=True
    )
    cluster_of = DBSCAN(eps=_LINK / _CELL, min_samples=4).fit_predict(cells)[
        cell_of.ravel()
    ]
    counts = np.bincount(cluster_of[cluster_of >= 0], minlength=1)
    if counts.max() < _FEWEST:
        raise NotVisibleError(
            f"no {name} in view: the largest part that hangs together has {counts.max()} points"
        )
    return subset[cluster_of == counts.argmax()]
