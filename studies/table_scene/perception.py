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

from clothlab._validation import check_number
from clothlab.simulation.arm import BAR_RADIUS
from clothlab.simulation.cloth import Cloth
from clothlab.simulation.env import ClothEnv
from studies.table_scene.scene import Basket
from studies.table_scene.table_env import ClothPose

# [pixel] of a depth image, whose aspect is 4:3: at 1 m a pixel is 3 mm wide
_HEIGHT = 480
_FARTHEST = 3.0  # [m] what is farther away is of no use to the arm
_FEWEST = 150  # points of a thing; fewer are a scrap of it
_HUE = 40  # of 255, by which a colour must stand out, as in `vision.cloth_mask`
# Of 255: red and green stand out from blue by more in the basket's colour, by less
# in wood's
_YELLOW = 60
_DARK = 75  # of 255: only the bar is darker in every colour
_CELL = 0.01  # [m] of the coarse grid in which clusters are looked for
_LINK = 0.025  # [m] points nearer than that hang together
_BIN = 0.01  # [m] of the cloth's width, each of which has its uppermost point
_LEAST_WIDTH = 0.10  # [m] of an edge that can be told from a scrap
# [m] of the grid by which an area is measured: larger than any pixel seen at a slant
_AREA_CELL = 0.02
_ON_TOP = 0.02  # [m] above a table or below, what seems to lie on it
# Of 255: blue stands out from green by more on a cloth's red back, by less on its front
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
    # Which of them are not at the picture's border, where things are cut off: `[N]`,
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
    """How far each pixel's surface is from the camera: `[height, height * 4/3]` [m].

    Distances are along the axis of the camera, not along each line of sight.
    """
    picture = env.camera_picture(height, height * 4 // 3, depth=True)
    return picture.astype(np.float64)


def capture_point_cloud(
    env: ClothEnv,
    height: int = _HEIGHT,
    *,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> PointCloud:
    """Take a coloured point cloud of all that the scene's camera sees within 3 m.

    Args:
        env: the scene.
        height: of the depth image [pixel].
        noise: standard deviation of a pixel's depth at 1 m [m]. It grows with the
            square of the distance, as that of stereo cameras does.
        rng: draws the noise; a ValueError where there is noise and no rng.
    """
    # The two pictures of one look: how far, and in which colour
    depth = depth_picture(env, height)
    colours = env.camera_picture(height, height * 4 // 3)
    if check_number("noise", noise, at_least=0):
        if rng is None:
            raise ValueError(
                "a noisy depth image needs an rng: numpy.random.default_rng(seed)"
            )
        depth += rng.normal(0.0, noise, depth.shape) * depth**2

    # From pixels to the world
    camera = env.data.camera("camera")
    axes = camera.xmat.reshape(3, 3).T
    fovy = float(env.model.camera("camera").fovy[0])
    points = _depth_points(depth, fovy, camera.xpos, axes)

    # Only what is near; what the border may have cut off is marked
    inside = np.zeros(depth.shape, bool)
    inside[2:-2, 2:-2] = True
    near = depth < _FARTHEST
    return PointCloud(points[near], colours[near], inside[near], camera.xpos.copy())


def _depth_points(
    depth: np.ndarray, fovy: float, position: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """Where in the world the pixels of a depth image are: a pinhole camera, backwards.

    Depths are `[h, w]` [m], places `[h, w, 3]` [m].
    """
    height, width = depth.shape
    focal = 0.5 * height / np.tan(np.deg2rad(fovy) / 2)  # [pixel]

    # The line of sight of each pixel in the camera's frame, which looks along -z
    rays = np.empty((height, width, 3))
    rays[..., 0] = (np.arange(width) + 0.5 - width / 2) / focal
    rays[..., 1] = -(np.arange(height)[:, None] + 0.5 - height / 2) / focal
    rays[..., 2] = -1.0
    return position + depth[..., None] * (rays @ axes)


def find_cloth_edge(cloud: PointCloud) -> np.ndarray:
    """Find the ends of a hanging cloth's upper edge by a robust line: `[2, 3]` [m].

    The first end is to the robot's right, the second to its left.
    """
    cloth = _largest_cluster("cloth", cloud, _cloth_coloured(cloud.colours))
    x, y, z = cloth.points.T

    # The uppermost point in each centimetre of the width
    bins = np.floor((y - y.min()) / _BIN).astype(int)
    highest_first = np.lexsort((-z, bins))
    _, first_of_bin = np.unique(bins[highest_first], return_index=True)
    top = highest_first[first_of_bin]
    in_view = len(top) * _BIN
    if in_view < _LEAST_WIDTH:
        raise NotVisibleError(
            f"only {100 * in_view:.0f} cm of the cloth's edge are in view: "
            "look from elsewhere"
        )

    # A line through them: x and z as functions of y
    from sklearn.linear_model import RANSACRegressor  # slow to import

    line = RANSACRegressor(residual_threshold=_BIN, random_state=0)
    line.fit(y[top, None], np.column_stack([x[top], z[top]]))
    on_edge = top[line.inlier_mask_]
    if np.mean(cloth.inside[on_edge]) < 0.9:
        raise NotVisibleError(
            "the cloth's upper edge is cut off by the picture: look from farther away"
        )

    # Where that line begins and ends
    ends = np.array([y[on_edge].min(), y[on_edge].max()])
    along = line.predict(ends[:, None])
    return np.column_stack([along[:, 0], ends, along[:, 1]])


def find_cloth_pose(cloud: PointCloud, height: float, cloth: Cloth) -> ClothPose:
    """Find how a cloth lies on a table of that height [m]."""
    seen = _largest_cluster("cloth", cloud, _cloth_coloured(cloud.colours))
    level = np.abs(seen.points[:, 2] - height) < _ON_TOP
    on_table = seen.points[level]

    # Cells of a grid that it covers; a scrap has no pose
    cells = np.unique(np.floor(on_table[:, :2] / _AREA_CELL), axis=0)
    if len(cells) < 4:
        return ClothPose(0.0, 0.0, 0.0, seen.points.mean(axis=0), back_up=False)

    # The rectangle around it says where it lies, and how it is turned
    centre, size, angle = cv2.minAreaRect(on_table[:, :2].astype(np.float32))
    turned = (angle + 45.0) % 90.0 - 45.0
    place = np.array([*centre, on_table[:, 2].mean()])

    # The cells at the outline are covered by half on average.
    covered = len(cells) * _AREA_CELL**2 - sum(size) * _AREA_CELL
    area = covered / (cloth.length * cloth.width)

    # Which side is up is a matter of colour
    _, green, blue = np.median(seen.colours[level].astype(int), axis=0)
    return ClothPose(
        flat=float(level.mean()),
        area=float(area),
        angle=turned,
        centre=place,
        back_up=bool(blue - green > _BACK),
    )


def find_cloth_centre(cloud: PointCloud, height: float) -> np.ndarray:
    """Find the middle `[3]` [m] of a cloth that lies on a table of that height [m].

    It is the middle of the rectangle around all that is seen of it.
    """
    level = np.abs(cloud.points[:, 2] - height) < _LINK
    coloured = _cloth_coloured(cloud.colours)
    cloth = _largest_cluster("cloth on the table", cloud, level & coloured)
    centre, _, _ = cv2.minAreaRect(cloth.points[:, :2].astype(np.float32))
    return np.array([*centre, cloth.points[:, 2].mean()])


def find_basket(cloud: PointCloud) -> tuple[np.ndarray, float]:
    """Find an upright basket: the middle of its bottom `[3]` [m], and its turn.

    The turn is seen from above, -90 to 90 [degree]. By least squares between points and
    surface: in 24 places, with noise of 2 mm at 1 m, off by 0.3 mm and 0.15° at most
    (`cv2.minAreaRect` of the rim and the median height of the rod: 5.3 mm and 0.43°).
    """
    # Yellow points that hang together, not cut off by the picture
    red, green, blue = cloud.colours.astype(int).T
    basket = _largest_cluster("basket", cloud, np.minimum(red, green) - blue > _YELLOW)
    if np.mean(basket.inside) < 0.99:
        raise NotVisibleError(
            "the basket is cut off by the picture: look from farther away"
        )

    # 1,500 of them are enough. The fit begins below their highest one, in four turns.
    points = basket.points[:: max(1, len(basket) // 1500)]
    level = np.median(points[:, :2], axis=0)
    middle = np.append(level, points[:, 2].max() - Basket.handle_height)

    def distance(pose: np.ndarray) -> np.ndarray:
        return _basket_distance(points, pose[:3], pose[3])

    fits = []
    for turn in np.deg2rad([-60, -20, 20, 60]):
        start = np.append(middle, turn)
        fits.append(least_squares(distance, start, loss="soft_l1", f_scale=0.005))
    best = min(fits, key=lambda fit: fit.cost)
    bottom = best.x[:3]
    turn = (best.x[3] + np.pi / 2) % np.pi - np.pi / 2

    # Without the rod of its handle in view, the height is a guess
    rod = np.abs(basket.points[:, 2] - (bottom[2] + Basket.handle_height)) < _ROD_SLACK
    if rod.sum() < _FEWEST / 10:
        raise NotVisibleError("the basket's handle is hidden: look from elsewhere")
    return bottom, float(np.rad2deg(turn))


def find_bar(cloud: PointCloud, near: ArrayLike) -> np.ndarray:
    """Find the middle of the bar in the hand `[3]` [m].

    It is looked for `near` where it should be `[3]` [m]: dark elsewhere is the shade.
    """
    # Dark points around the hand
    dark = (cloud.colours < _DARK).all(axis=1)
    around = np.linalg.norm(cloud.points - near, axis=1) < _BAR_WITHIN
    bar = cloud[dark & around]
    if len(bar) < _FEWEST / 3 or np.ptp(bar.points[:, 1]) < _LEAST_WIDTH:
        raise NotVisibleError("the bar is not in view where the hand should be")

    # The camera sees the near side of a round bar; its axis lies behind, a little less
    # than a radius on average.
    sight = bar.points - cloud.camera
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    axis = bar.points + sight * BAR_RADIUS * np.pi / 4

    # Points far from the others are none of the bar
    across = axis[:, [0, 2]]
    off_axis = np.linalg.norm(across - np.median(across, axis=0), axis=1)
    good = axis[off_axis < 2 * _LINK]
    forward, up = np.median(good[:, [0, 2]], axis=0)
    aside = np.mean([good[:, 1].min(), good[:, 1].max()])
    return np.array([forward, aside, up])


def _basket_distance(points: np.ndarray, bottom: np.ndarray, turn: float) -> np.ndarray:
    """How far points `[N, 3]` [m] are outside the surface of a basket, `[N]` [m].

    The basket is turned by `turn` [rad]; distances are negative inside of it.
    """
    # Into the basket's frame
    cos = np.cos(turn)
    sin = np.sin(turn)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    local = (points - bottom) @ rotation

    # Its body is a box: outside, the distance to it; inside, that to the nearest wall
    half = np.array(Basket.size) / 2
    beyond = np.abs(local - [0.0, 0.0, half[2]]) - half
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    box = outside + np.minimum(beyond.max(axis=1), 0.0)

    # Its handle is a rod on two legs: nearest are a point of the rod, and one of the
    # leg on the same side.
    _, y, z = local.T
    middle = np.zeros_like(y)
    side = Basket.handle_width / 2
    top = Basket.handle_height
    rod = np.column_stack([middle, np.clip(y, -side, side), np.full_like(y, top)])
    leg = np.column_stack(
        [middle, np.where(y < 0, -side, side), np.clip(z, Basket.size[2], top)]
    )
    to_rod = np.linalg.norm(local - rod, axis=1)
    to_leg = np.linalg.norm(local - leg, axis=1)
    handle = np.minimum(to_rod, to_leg) - Basket.handle_radius
    return np.minimum(box, handle)


def _cloth_coloured(colours: np.ndarray) -> np.ndarray:
    """Whether they may be the cloth's: its red front or its blue back `[N]`, bool."""
    red, green, blue = colours.astype(int).T
    front = red - np.maximum(green, blue) > _HUE
    back = blue - np.maximum(red, green) > _HUE
    return front | back


def _largest_cluster(name: str, cloud: PointCloud, coloured: np.ndarray) -> PointCloud:
    """The largest part of the coloured points that hangs together."""
    subset = cloud[coloured]
    if len(subset) < _FEWEST:
        raise NotVisibleError(
            f"no {name} in view: {len(subset)} points have its colour, "
            f"{_FEWEST} are needed"
        )

    from sklearn.cluster import DBSCAN  # slow to import

    # Cells of a grid in place of points, of which there are far more
    places = np.floor(subset.points / _CELL).astype(int)
    cells, cell_of = np.unique(places, axis=0, return_inverse=True)
    cluster_of_cell = DBSCAN(eps=_LINK / _CELL, min_samples=4).fit_predict(cells)
    cluster_of = cluster_of_cell[cell_of.ravel()]

    # DBSCAN calls what belongs to no cluster -1
    counts = np.bincount(cluster_of[cluster_of >= 0], minlength=1)
    if counts.max() < _FEWEST:
        raise NotVisibleError(
            f"no {name} in view: the largest part that hangs together has "
            f"{counts.max()} points"
        )
    return subset[cluster_of == counts.argmax()]
