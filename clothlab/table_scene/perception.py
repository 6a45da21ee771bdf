"""Which points are the cloth, the basket, the bar in the hand, and where to take hold.

The paper's robot recognises cloth and basket in point clouds; how, its section "Integrated Table Setting Experiment"
does not say. Here colour says which points may belong to a thing, and DBSCAN which of them hang together, for pixels on
an outline take their colour from the thing and their depth from what is behind. Poses are fitted to what remains.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import OptimizeResult, least_squares
from sklearn.cluster import DBSCAN
from sklearn.linear_model import RANSACRegressor

from clothlab._validation import check_array, check_number
from clothlab.simulation.arm import BAR_RADIUS
from clothlab.simulation.cloth import Cloth
from clothlab.table_scene.depth import PointCloud
from clothlab.table_scene.scene import Basket

FEWEST = 150  # points of a thing; fewer are a scrap of it
HUE = 40  # of 255, by which a colour must stand out, as in `vision.cloth_mask`
YELLOW = 60  # of 255, by which red and green stand out from blue in the basket's colour, not in wood's
DARK = 75  # of 255: only the bar is darker in every colour
CELL = 0.01  # [m] of the coarse grid in which clusters are looked for
LINK = 0.025  # [m] points nearer than that hang together
BIN = 0.01  # [m] of the cloth's width, each of which has its uppermost point
LEAST_WIDTH = 0.10  # [m] of an edge that can be told from a scrap
LAID_CELL = 0.02  # [m] of the grid by which its area is measured: no pixel of it is as large, seen at a slant
FLAT_SEEN = 0.02  # [m] above a table or below, what seems to lie on it
BACK = 14  # of 255, by which blue stands out from green on a cloth's red back, not on its front
ROD_SLACK = 0.02  # [m] above and below the rod, what still belongs to it


class NotInView(RuntimeError):
    """What was looked for is not to be seen, or not enough of it."""


@dataclass(frozen=True, eq=False)
class SeenCloth:
    """A cloth that hangs by its upper edge.

    Attributes:
        ends: of that edge, to the robot's right and to its left `[2, 3]` [m].
        points: how many points of the cloth were seen.
    """

    ends: np.ndarray
    points: int

    @property
    def place(self) -> np.ndarray:
        """The middle of the edge, where the hand should take hold `[3]` [m]."""
        return self.ends.mean(axis=0)

    @property
    def turn(self) -> float:
        """From an edge that lies across to this one, counterclockwise seen from above [degree]."""
        across = self.ends[1] - self.ends[0]
        return float(np.rad2deg(np.arctan2(-across[0], across[1])))

    @property
    def slant(self) -> float:
        """From level, up towards the robot's left [degree]."""
        across = self.ends[1] - self.ends[0]
        return float(np.rad2deg(np.arctan2(across[2], np.hypot(*across[:2]))))


@dataclass(frozen=True, eq=False)
class SeenBasket:
    """A basket that stands upright.

    Attributes:
        bottom: the middle of its bottom `[3]` [m].
        turn: counterclockwise seen from above [degree], from -90 to 90: it looks the same from behind.
        place: the middle of its handle's rod, where the hand should take hold `[3]` [m].
        residual: how far the points are from the fitted surface, root mean square [m].
    """

    bottom: np.ndarray
    turn: float
    place: np.ndarray
    residual: float


@dataclass(frozen=True, eq=False)
class LaidCloth:
    """A cloth that lies on a table.

    Attributes:
        centre: of the rectangle around what is seen of it `[3]` [m].
        size: of that rectangle, the longer side first `[2]` [m].
    """

    centre: np.ndarray
    size: np.ndarray


@dataclass(frozen=True, eq=False)
class SeenSpread:
    """How well a cloth seems to lie on a table; `table.Spread` is how well it does.

    Attributes:
        flat: part of its seen surface that is on the table.
        area: what it covers, as a part of the flat cloth's area. What the arm hides is missing.
        angle: of the rectangle around it, from straight ahead, -45 to 45 [degree].
        back_up: whether its back is up, as when its far edge went forward.
        centre: of that rectangle `[3]` [m].
    """

    flat: float
    area: float
    angle: float
    back_up: bool
    centre: np.ndarray

    @property
    def success(self) -> bool:
        """Whether that looks like a cloth spread out, its far edge forward."""
        return self.back_up and self.flat >= 0.85 and self.area >= 0.85 and abs(self.angle) <= 15.0


def find_spread(cloud: PointCloud, height: float, cloth: Cloth) -> SeenSpread:
    """Find how a cloth lies on a table of that height [m]: a robot's own verdict on its throw.

    Raises:
        NotInView: no cloth to be seen.
    """
    seen = _one_thing("cloth", cloud, _cloth_coloured(cloud.colours))
    level = np.abs(seen.points[:, 2] - check_number("height", height)) < FLAT_SEEN
    cells = np.unique(np.floor(seen.points[level, :2] / LAID_CELL), axis=0)
    if len(cells) < 4:
        return SeenSpread(0.0, 0.0, 0.0, False, seen.points.mean(axis=0))
    centre, size, angle = cv2.minAreaRect(seen.points[level][:, :2].astype(np.float32))
    # The cells at the outline are covered by half on average.
    area = (len(cells) * LAID_CELL**2 - sum(size) * LAID_CELL) / (cloth.length * cloth.width)
    _, green, blue = np.median(seen.colours[level].astype(int), axis=0)
    turned = (angle + 45.0) % 90.0 - 45.0
    place = np.array([*centre, seen.points[level, 2].mean()])
    return SeenSpread(float(level.mean()), float(area), turned, bool(blue - green > BACK), place)


def find_cloth(cloud: PointCloud) -> SeenCloth:
    """Find a hanging cloth by its colour, and its upper edge by a robust line through its uppermost points.

    Raises:
        NotInView: no cloth, less of it than an edge needs, or an edge that the picture cuts off.
    """
    cloth = _one_thing("cloth", cloud, _cloth_coloured(cloud.colours))
    y, z = cloth.points[:, 1:].T
    bins = np.floor((y - y.min()) / BIN).astype(int)
    order = np.lexsort((-z, bins))
    top = order[np.unique(bins[order], return_index=True)[1]]
    if len(top) * BIN < LEAST_WIDTH:
        raise NotInView(f"only {100 * len(top) * BIN:.0f} cm of the cloth's edge are in view: look from elsewhere")
    line = RANSACRegressor(residual_threshold=BIN, random_state=0).fit(y[top, None], cloth.points[top][:, [0, 2]])
    on_edge = top[line.inlier_mask_]
    if np.mean(cloth.inside[on_edge]) < 0.9:
        raise NotInView("the cloth's upper edge is cut off by the picture: look from farther away")
    reach = np.array([y[on_edge].min(), y[on_edge].max()])
    along = line.predict(reach[:, None])
    return SeenCloth(np.column_stack([along[:, 0], reach, along[:, 1]]), len(cloth))


def find_laid_cloth(cloud: PointCloud, height: float) -> LaidCloth:
    """Find a cloth that lies on a table of that height [m].

    Raises:
        NotInView: no cloth there.
    """
    level = np.abs(cloud.points[:, 2] - check_number("height", height)) < LINK
    cloth = _one_thing("cloth on the table", cloud, level & _cloth_coloured(cloud.colours))
    centre, size, _ = cv2.minAreaRect(cloth.points[:, :2].astype(np.float32))
    return LaidCloth(np.array([*centre, cloth.points[:, 2].mean()]), np.sort(size)[::-1])


def find_basket(cloud: PointCloud, basket: Basket | None = None) -> SeenBasket:
    """Find the basket by its colour, and its pose by least squares between points and surface.

    Args:
        cloud: what the camera saw.
        basket: its measures.

    Raises:
        NotInView: no basket, its handle hidden, or cut off by the picture.
    """
    basket = basket or Basket()
    red, green, blue = cloud.colours.astype(int).T
    thing = _one_thing("basket", cloud, np.minimum(red, green) - blue > YELLOW)
    if np.mean(thing.inside) < 0.99:
        raise NotInView("the basket is cut off by the picture: look from farther away")
    some = thing.points[:: max(1, len(thing) // 1500)]
    middle = np.append(np.median(some[:, :2], axis=0), some[:, 2].max() - basket.handle_height)
    tries = [_fit_basket(some, basket, np.append(middle, turn)) for turn in np.deg2rad([-60, -20, 20, 60])]
    best = min(tries, key=lambda fit: fit.cost)
    bottom, turn = best.x[:3], (best.x[3] + np.pi / 2) % np.pi - np.pi / 2
    place = np.add(bottom, [0.0, 0.0, basket.handle_height])
    rod = np.abs(thing.points[:, 2] - place[2]) < ROD_SLACK
    if rod.sum() < FEWEST / 10:
        raise NotInView("the basket's handle is hidden: look from elsewhere")
    residual = float(np.sqrt(np.mean(basket_distance(some, basket, bottom, turn) ** 2)))
    return SeenBasket(bottom, float(np.rad2deg(turn)), place, residual)


def find_bar(cloud: PointCloud, near: ArrayLike, within: float = 0.30) -> np.ndarray:
    """Find the middle of the bar in the hand `[3]` [m].

    Args:
        cloud: what the camera saw.
        near: where the robot feels its hand `[3]` [m]: what is dark elsewhere is in the shade.
        within: how far from there the bar's ends may be [m].

    Raises:
        NotInView: no bar there.
    """
    near = check_array("near", near, (3,))
    dark = (cloud.colours < DARK).all(axis=1)
    bar = cloud[dark & (np.linalg.norm(cloud.points - near, axis=1) < check_number("within", within, above=0))]
    if len(bar) < FEWEST / 3 or np.ptp(bar.points[:, 1]) < LEAST_WIDTH:
        raise NotInView("the bar is not in view where the hand is felt")
    # The camera sees the near side of a round bar; its axis lies behind, a little less than a radius on average.
    behind = bar.points - cloud.camera
    axis = bar.points + behind / np.linalg.norm(behind, axis=1, keepdims=True) * BAR_RADIUS * np.pi / 4
    good = np.linalg.norm(axis[:, [0, 2]] - np.median(axis[:, [0, 2]], axis=0), axis=1) < 2 * LINK
    forward, up = np.median(axis[good][:, [0, 2]], axis=0)
    return np.array([forward, np.mean([axis[good, 1].min(), axis[good, 1].max()]), up])


def basket_distance(points: np.ndarray, basket: Basket, bottom: np.ndarray, turn: float) -> np.ndarray:
    """How far points `[N, 3]` [m] are outside the surface of a basket (negative: inside) `[N]` [m]."""
    turn = check_number("turn", turn)
    cos, sin = np.cos(turn), np.sin(turn)
    local = (points - bottom) @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    half = np.array(basket.size) / 2
    beyond = np.abs(local - [0.0, 0.0, half[2]]) - half
    box = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    side, top = basket.handle_width / 2, basket.handle_height
    # Nearest points on the rod, and on the leg of the same side.
    rod = np.column_stack([np.zeros(len(local)), np.clip(local[:, 1], -side, side), np.full(len(local), top)])
    leg = np.column_stack(
        [np.zeros(len(local)), np.where(local[:, 1] < 0, -side, side), np.clip(local[:, 2], basket.size[2], top)]
    )
    handle = np.minimum(*(np.linalg.norm(local - nearest, axis=1) for nearest in (rod, leg)))
    return np.minimum(box, handle - basket.handle_radius)


def _fit_basket(points: np.ndarray, basket: Basket, start: np.ndarray) -> OptimizeResult:
    return least_squares(
        lambda pose: basket_distance(points, basket, pose[:3], pose[3]), start, loss="soft_l1", f_scale=0.005
    )


def _cloth_coloured(colours: np.ndarray) -> np.ndarray:
    """Whether they may be the cloth's: its red front or its blue back `[N]`, bool."""
    red, green, blue = colours.astype(int).T
    return (red - np.maximum(green, blue) > HUE) | (blue - np.maximum(red, green) > HUE)


def _one_thing(what: str, cloud: PointCloud, coloured: np.ndarray) -> PointCloud:
    """The largest part of the coloured points that hangs together."""
    some = cloud[coloured]
    if len(some) < FEWEST:
        raise NotInView(f"no {what} in view: {len(some)} points have its colour, {FEWEST} are needed")
    cells, cell_of = np.unique(np.floor(some.points / CELL).astype(int), axis=0, return_inverse=True)
    cluster_of = DBSCAN(eps=LINK / CELL, min_samples=4).fit_predict(cells)[cell_of.ravel()]
    counts = np.bincount(cluster_of[cluster_of >= 0], minlength=1)
    if counts.max() < FEWEST:
        raise NotInView(f"no {what} in view: the largest part that hangs together has {counts.max()} points")
    return some[cluster_of == counts.argmax()]
