"""Exercises: a stub, its solution, and a check that refuses wrong answers and says why."""

import ast
import json
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_limits

import clothlab
from clothlab import checks
from clothlab.checks._check import array, check, number
from clothlab.checks.cloth_simulation import acceleration

NOTEBOOKS = sorted((Path(clothlab.__file__).parents[1] / "notebooks").glob("*.ipynb"))
LESSONS = {"acceleration": acceleration}  # what solutions take from their lesson


@pytest.fixture(autouse=True, scope="module")
def one_core():
    """The principal axes of a few small images take ten times as long on two cores that are busy."""
    with threadpool_limits(1):
        yield


def code_cells(path):
    """Tags and source of the code cells, in order."""
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] == "code":
            yield set(cell["metadata"].get("tags", [])), "".join(cell["source"])


def tagged(path, tag):
    return [source for tags, source in code_cells(path) if tag in tags]


def functions(source):
    return [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]


def signatures(source):
    return [(node.name, ast.unparse(node.args), ast.get_docstring(node)) for node in functions(source)]


def exercises():
    """Each exercise by its function's name: its notebook, stub and solution."""
    found = {}
    for path in NOTEBOOKS:
        for stub, solution in zip(tagged(path, "stub"), tagged(path, "solution"), strict=True):
            name = functions(stub)[0].name
            assert name not in found, f"{path.stem} has a second exercise called {name}: checks go by their names"
            found[name] = path, stub, solution
    return found


EXERCISES = exercises()


def define(name, source):
    """The function as the notebook's reader would have it: after the notebook's imports."""
    namespace = dict(LESSONS)
    for _, cell in code_cells(EXERCISES[name][0]):
        imports = [node for node in ast.parse(cell).body if isinstance(node, ast.Import | ast.ImportFrom)]
        exec(ast.unparse(ast.Module(imports, [])), namespace)
    exec("\n".join(ast.unparse(node) for node in functions(source)), namespace)
    return namespace[name]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_two_to_four_exercises_each_of_stub_solution_and_check(path):
    cells = list(code_cells(path))
    stubs = [k for k, (tags, _) in enumerate(cells) if "stub" in tags]
    assert 2 <= len(stubs) <= 4
    assert len(stubs) == len(tagged(path, "solution"))
    for k in stubs:
        (_, stub), (tags, solution), (_, check) = cells[k : k + 3]
        assert "solution" in tags, "the solution follows its stub"
        assert signatures(stub) == signatures(solution)
        (name, *_), *others = signatures(stub)
        assert not others, "one function to an exercise"
        assert check.startswith(f"checks.{name}({name})"), f"the check of {name} is clothlab.checks.{name}"
        assert getattr(checks, name).__module__ == f"clothlab.checks.{path.stem[3:]}"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_checks_live_in_the_package_where_they_are_tested(path):
    for _, source in code_cells(path):
        assert not [node.name for node in functions(source) if node.name.startswith("check_")]


def test_every_check_belongs_to_an_exercise():
    assert set(checks.__all__) - {"CheckFailed"} == set(EXERCISES)


@pytest.mark.parametrize("name", EXERCISES)
def test_stubs_are_refused_and_solutions_are_not(name, capsys):
    _, stub, solution = EXERCISES[name]
    with pytest.raises(checks.CheckFailed, match=r"\w \w"):
        getattr(checks, name)(define(name, stub))
    assert capsys.readouterr().out == ""
    getattr(checks, name)(define(name, solution))
    assert capsys.readouterr().out == "correct\n"


# What goes wrong easily: the solution with `right` replaced by `wrong`, and what the reader is told. Where `right` is
# "return", `wrong` is what the last line returns instead; where it is "body", all that the function does.
SLIPS = {
    "best_moment": [
        ("skip + np.argmin(distance[skip:])", "np.argmin(distance)", "first two steps do not count"),
        ("skip + np", "np", "from the start of the run"),
        ("0.2 * ", "", "a step lasts 0.2 s"),
        ("return", "distance[skip:].min()", "return its time"),
        ("argmin", "argmax", "largest distance"),
        ("skip + np", "skip + 1 + np", "count from 0"),
        ("body", "return 0.2 * (8 + np.argmin(distance[8:]))", "not always eight"),
        ("body", "return 0.2 * (2 + np.argmin(distance[2:]))", "eight steps are left out"),
        ("return", "0.2 * len(distance)", "at 0.6 s, not 2.4 s"),
        ("body", "distance[:skip] = np.inf; return 0.2 * np.argmin(distance)", "changes its argument `distance`"),
    ],
    "share_won": [
        ("best_a < best_b", "best_a <= best_b", "both come equally close"),
        ("best_a < best_b", "best_a > best_b", "periods that `b` wins"),
        ("(best_a < best_b).mean()", "(best_a < best_b).sum()", "number of periods won"),
        ("return ", "return 100 * ", "per cent"),
        (".min(axis=1)", ".mean(axis=1)", "not the mean"),
        ("return", "(np.asarray(a) < b).mean()", "share of steps"),
        ("return", "float(min(a) < min(b))", "0.5, not 1"),
        ("mean()", "sum() / -(-len(a) // period)", "divide by the number of whole periods"),
        (
            "body",
            "w = [min(a[k:][:period]) < min(b[k:][:period]) for k in range(0, len(a), period)]; return np.mean(w)",
            "the last step is none",
        ),
        ("[:whole]", "[len(x) - whole :]", "periods count from the start"),
    ],
    "count_springs": [
        (
            "structural = (rows - 1) * columns + (rows - 1)",
            "structural = (rows - 1) * columns + rows",
            "no spring lies within",
        ),
        ("structural = (rows - 1) * columns", "structural = rows * columns", "25 structural springs, not 28"),
        ("shear = 2 * (rows", "shear = (rows", "two diagonals"),
        ("(rows - 1) * (columns - 2)", "rows * (columns - 2)", "bending springs, not 18; the first row is held"),
        ("(rows - 2) * columns", "(rows - 1) * columns", "17 bending springs, not 20"),
        ("structural, shear, bending", "structural, bending, shear", "in another order"),
        ("structural, shear, bending", "structural + shear + bending", "of the shape (3,)"),
        ("body", "return 25, 20, 17", "points have 27 structural"),
    ],
    "time_to_reach": [
        ("cloth.point_mass", "cloth.mass", "mass of one point"),
        ("np.log(1 - share)", "np.log(share)", "still missing"),
        ("-cloth", "cloth", "the cloth is dropped at 0 s"),
        ("cloth.point_mass / cloth.damping", "1.0", "how do mass and drag"),
        ("cloth.point_mass / cloth.damping", "cloth.damping / cloth.point_mass", "upside down"),
        ("log(", "log10(", "natural logarithm"),
        ("return", "share * cloth.point_mass / cloth.damping", "in the first moment"),
        ("return", "0.3", "not 60%"),
        ("return", "1e9", "has 100% of its terminal speed"),
    ],
    "euler_step": [
        ("v = v + dt *", "v += dt *", "in place: work on a copy"),
        ("v[: cloth.columns] = 0.0", "pass", "its velocity stays zero"),
        ("v[: cloth.columns]", "v[:1]", "three points, is held"),
        (
            "v[: cloth.columns] = 0.0\n    return x + dt * v, v",
            "x = x + dt * v; v[:3] = 0; return x, v",
            "it does not move",
        ),
        ("acceleration(cloth, x, v)", "acceleration(cloth, x, 0 * v)", "acceleration(cloth, x, v)"),
        ("v = v + dt *", "v = dt *", "the change of the velocities alone"),
        ("dt * acceleration", "acceleration", "multiplied by the time step"),
        ("dt * acceleration", "0.001 * acceleration", "always 0.001 s"),
        ("v + dt * acceleration(cloth, x, v)", "v.copy()", "where are the accelerations"),
        ("x + dt * v, v", "v, x + dt * v", "first the positions"),
        ("x + dt * v, v", "dt * v, v", "not where they are then"),
        ("x + dt * v, v", "x, v", "the points do not move"),
        ("v = v", "x = x + dt * v; v = v", "before the points move"),
        (
            "v = v + dt * acceleration(cloth, x, v)",
            "x, v = x + dt * v, v + dt * acceleration(cloth, x, v); v[:3] = 0; return x, v",
            "not the old",
        ),
    ],
    "pair_stiffness": [
        ("2 * r", "r", "two muscles"),
        ("2 * r", "-2 * r", "a positive number"),
        ("r**2", "r", "r enters twice"),
        ("3 * k3", "k3", "df/de, not f/e"),
        ("e0**2", "e0", "slope is"),
        ("k1 + 3 * k3 * e0**2", "k1", "slope is"),
        ("return", "0.0", "slope is"),
    ],
    "compliance": [
        ("+ 1 / arm.motor_stiffness", "", "motors are rigid"),
        (
            "1 / (1 / arm.spring_stiffness(f_const) + 1 / arm.motor_stiffness)",
            "arm.spring_stiffness(f_const) + arm.motor_stiffness",
            "not their stiffnesses that add up",
        ),
        ("spring_stiffness(f_const)", "spring_stiffness(arm.elongation(f_const))", "not its stretch"),
        ("arm.spring_stiffness(f_const)", "(f_const / arm.elongation(f_const))", "not f/e"),
        ("J @ np.linalg.inv(k * G.T @ G) @ J.T", "J.T @ np.linalg.inv(k * G.T @ G) @ J", "changed places"),
        ("@ J.T", "@ J", "symmetric"),
        ("return", "np.linalg.inv(k * G.T @ G)", "where does J enter"),
        ("np.linalg.inv(k * G.T @ G)", "(k * G.T @ G)", "in place of its inverse"),
        ("return", "np.linalg.inv(J @ np.linalg.inv(k * G.T @ G) @ J.T)", "the inverse of C"),
        ("k * G.T", "G.T", "tiny pushes"),
        ("return", "J @ np.linalg.inv(G @ G.T) @ J.T", "raised"),
    ],
    "length_for_measured_tension": [
        ("- (f - arm.tension_bias) / arm.motor_stiffness", "", "l_ref"),
        ("f - arm.tension_bias", "f", "subtract it"),
        (") - (f", ") + (f", "not a longer one"),
        ("arm.body_image(theta_ref, f)", "theta_ref @ arm.moment_arms.T", "springs stretch, too"),
        ("arm.body_image(theta_ref, f) -", "", "where is the length"),
        ("(theta_ref, f)", "(theta_ref, np.full(6, f.mean()))", "the motors pull"),
        ("(theta_ref, f)", "(arm.home_command[:2], f)", "the motors pull"),
        ("return", "np.full(6, 0.1)", "the motors pull"),
    ],
    "transitions": [
        ("robot[1:]", "robot[:-1]", "one step later"),
        ("commands[:-1]", "commands[1:]", "between states"),
        ("commands[:-1]", "commands", "have an after"),
        ("return", "trial.robot[1:], trial.commands[:-1], trial.robot[:-1]", "changed places"),
        ("return", "trial.robot[1:], trial.commands[1:], trial.robot[1:]", "is not a before"),
        ("return", "trial.robot[:-1], trial.robot[1:], trial.commands[:-1]", "the commands between them, of the shape"),
        ("return", "trial.images[:-1], trial.commands[:-1], trial.images[1:]", "the states, of the shape"),
        ("return", "list(zip(trial.robot[:-1], trial.commands, trial.robot[1:]))", "return three arrays"),
    ],
    "wave": [
        ("(lower + upper) / 2 +", "", "middle of the range"),
        ("sin(", "cos(", "middle of the range"),
        ("+ (upper", "- (upper", "which lowers the arm"),
        ("np.sin(next(angles))", "np.array([1, -1]) * np.sin(next(angles))", "both of them"),
        ("(upper - lower) / 2", "(upper - lower) / 4", "the wave reaches"),
        ("(upper - lower) / 2", "(upper - lower).max() / 2", "the wave reaches"),
        ("/ period", "/ 10", "starts again"),
        ("/ period", "/ 8", "starts again"),
        ("2 * np.pi", "4 * np.pi", "yours sooner"),
        ("2 * np.pi", "np.pi", "starts again"),
        ("np.sin(next(angles))", "2 / np.pi * np.arcsin(np.sin(next(angles)))", "not a sine"),
        ("range(10**9)", "range(period)", "raised StopIteration"),
        (
            "iter(2 * np.pi * k / period for k in range(10**9))",
            "(2 * np.pi * k / period for k in vars(arm).setdefault('k', iter(range(99))))",
            "counts its own steps",
        ),
        ("lambda observation: ", "", "return a policy"),
        ("lambda observation: ", "lambda: ", "takes 0 positional arguments"),
    ],
    "take_turns": [
        ("// every % 2", "% 2", "eight steps ask"),
        ("// every % 2", "// 3 % 2", "with every=2"),
        ("// every % 2", "// every == 1", "with every=2"),
        ("(first, second)", "(second, first)", "`first` comes first"),
        ("(observation)", "(0.0)", "pass the observation on"),
        (
            "(first, second)[next(steps) // every % 2](observation)",
            "(first(observation), second(observation))[next(steps) // every % 2]",
            "whose turn it is",
        ),
        ("(observation)", "(observation) + 1", "as it is"),
        ("return", "first", "yours asked"),
        ("body", "u = first(0.0); return lambda observation: u", "before there is an observation"),
    ],
    "handmade": [
        ("np.zeros(3)", "np.zeros(2)", "of the shape (3,)"),
        ("np.zeros(3)", "np.ones(3)", "three zeros"),
        ("np.zeros(3)", "np.full(3, np.nan)", "nan among its numbers: return area, mean column and mean row, or zeros"),
        ("columns.mean(), rows.mean()", "rows.mean(), columns.mean()", "changed places"),
        (
            "columns.mean(), rows.mean()",
            "(columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2",
            "the box around the mask",
        ),
        ("columns.mean(), rows.mean()", "np.median(columns), np.median(rows)", "median"),
        ("columns.mean(), rows.mean()", "columns.mean() / 128, rows.mean() / 96", "shares of the image"),
        ("columns.mean(), rows.mean()", "columns.sum(), rows.sum()", "divide by the number of pixels"),
        ("columns.mean(), rows.mean()", "columns.mean() + 1, rows.mean() + 1", "count from 0"),
        ("columns.mean(), rows.mean()", "columns.mean(), 95 - rows.mean()", "and 75.83"),
        ("[len(rows),", "[mask.mean(),", "count pixels"),
        ("[len(rows),", "[mask.any(axis=0).sum(),", "120 pixels"),
    ],
    "linear_reconstruction": [
        ("PCA(components", "PCA(3", "more components"),
        ("images.shape", "len(images), -1", "of the shape (…, 96, 128)"),
        ("fit(train.reshape(len(train)", "fit(images.reshape(len(images)", "fit the PCA to `train` alone"),
        ("return ", "return 0.5 < ", "real numbers"),
        ("return ", "return -train.mean(axis=0) + ", "added again after"),
        ("import PCA\n", "import TruncatedSVD; PCA = lambda n, **kwargs: TruncatedSVD(n)\n", "is the mean subtracted"),
        ('PCA(components, svd_solver="randomized",', "PCA(components + 1,", "more axes"),
        ("return", "images", "real numbers"),
        ("return", "images + 0.0", "real numbers"),
        ("return", "train.mean(axis=0) + 0 * images", "more components"),
    ],
    "chamfer_by_hand": [
        ("return", "distances.min(axis=1).mean()", "only, from a to b"),
        ("return", "distances.min(axis=0).mean()", "only, from b to a"),
        ("mean()) / 2", "mean())", "halve it"),
        (
            "np.linalg.norm(a[:, None] - b[None, :], axis=-1)",
            "np.square(a[:, None] - b[None, :]).sum(axis=-1)",
            "squared",
        ),
        ("return", "max(distances.min(axis=1).max(), distances.min(axis=0).max())", "Hausdorff"),
        (".mean()", ".max()", "largest in each direction"),
        (".mean()", ".sum()", "a sum over the pixels"),
        ("return", "np.concatenate([distances.min(axis=1), distances.min(axis=0)]).mean()", "however many pixels"),
        ("return", "distances.mean()", "all pairs"),
        ("axis=-1)", "ord=1, axis=-1)", "Euclidean"),
        ("np.argwhere(a), np.argwhere(b)", "np.argwhere(a) / 128, np.argwhere(b) / 128", "side of one pixel"),
        ("np.argwhere(a), np.argwhere(b)", "np.argwhere(a)[:, 1:], np.argwhere(b)[:, 1:]", "pixels apart"),
        ("distances.min(axis=1).mean()", "distances.min(axis=1)", "return one number"),
        ("return", "0.0", "pixels apart, not 0"),
    ],
    "lstm_weights": [
        ("2 * units", "units", "more offsets"),
        ("4 * (", "(", "one gate"),
        ("4 * (", "3 * (", "a GRU"),
        (" + 2 * units", "", "offsets are weights"),
        (" + units * units", "", "own last output"),
        ("units * inputs + ", "", "looks at the inputs"),
        (
            "units * inputs + units * units + 2 * units",
            "units * inputs + inputs * inputs + 2 * inputs",
            "changed places",
        ),
        ("units * units + 2 * units)", "units * units + 2 * units) * 2", "PyTorch has 2320 weights, not 4640"),
        ("return", "7440", "not 7440: matrices of which sizes"),
    ],
    "extrapolate": [
        ("return", "s[2:]", "to be predicted"),
        ("return", "s[1:-1]", "add how they moved"),
        ("s[1:-1] + (", "s[1:-1] - (", "move back"),
        ("s[1:-1] + (s[1:-1] - s[:-2])", "s[:-2] + (s[1:-1] - s[:-2])", "add how they moved"),
        ("s[:-2])", "s[:-2]).mean(axis=1, keepdims=True)", "one velocity for all columns"),
        ("s[:-2])", "s[:-2])[:, :1]", "the first column's velocity"),
        ("s[:-2])", "s[:-2]).mean(axis=0)", "all move alike"),
        ("(s[1:-1] - s[:-2])", "s[1] - s[0]", "as in the very first step"),
        ("return", "[s[1] + (k + 1) * (s[1] - s[0]) for k in range(len(s) - 2)]", "earlier predictions"),
        ("(s[1:-1] - s[:-2])", "0.5 * (s[1:-1] - s[:-2])", "once more the way there"),
        ("s[1:-1] + (s[1:-1] - s[:-2])", "s[1:] + (s[1:] - s[:-1])", "four predictions"),
    ],
    "influence": [
        ("[0, -1, :3]", "[0, :, :3]", "the last image alone"),
        ("z.square().sum()", "z.norm()", "‖z‖, not of its square"),
        ("z.square().sum()", "z.sum()", "the sum of z, not of its squares"),
        ("z.square().sum()", "z.square().mean()", "a mean square"),
        ("[0, -1, :3]", "[0, -1]", "the whole state"),
        ("[0, -1, :3]", "[0, 0, :3]", "wrong for command 1, 2, 3, 4 of 4"),
        ("[0, -1, :3]", "[0, -1, -3:]", "of what is it the gradient"),
        ("gradient.norm(dim=1)", "gradient.square().sum(dim=1)", "squares of the lengths"),
        ("gradient.norm(dim=1)", "gradient.norm(dim=0)", "of the shape (4,)"),
        ("gradient.norm(dim=1)", "gradient.abs().sum(dim=1)", "of what is it the gradient"),
        ("gradient.norm(dim=1)", "gradient.norm(dim=1).flip(0)", "in reverse order"),
        ("u[None], p, memory", "u[None], p, None", "pass the memory on"),
        ("u.clone().requires_grad_()", "u.zero_().requires_grad_()", "changes its argument `u`"),
        (".requires_grad_()", "", "raised RuntimeError"),
    ],
    "matching_drag": [
        ("* mass / cloth.mass", "", "heavier cloth fall faster"),
        ("mass / cloth.mass", "cloth.mass / mass", "upside down"),
        ("cloth.mass", "cloth.point_mass", "compare like with like"),
        ("return", "cloth.terminal_speed", "that is a speed"),
        ("cloth.damping * ", "", "how many times"),
        ("* mass / cloth.mass", "/ cloth.mass", "drag over mass"),
        ("cloth.damping", "0.05", "falls at"),
        ("cloth.mass", "0.1", "falls at"),
        ("return", "-1.0", "falls at"),
    ],
    "shares_by_hand": [
        ("[::-1]", "", "the larger one first"),
        ("np.cov(np.asarray(points, dtype=float).T)", "points.T @ points", "subtract the mean"),
        ("np.cov(np.asarray(points, dtype=float).T)", "np.corrcoef(points.T)", "scikit-learn finds"),
        ("return eigenvalues / eigenvalues.sum()", "return eigenvalues", "divide by their sum"),
        ("return ", "return 100 * ", "per cent"),
        ("return ", "eigenvalues = np.sqrt(eigenvalues); return ", "not of its root"),
        ("return ", "eigenvalues = eigenvalues**2; return ", "a variance already"),
        ("return", "np.var(points, axis=0) / np.var(points, axis=0).sum()", "shares of the two columns"),
        ("eigenvalues.sum()", "eigenvalues.max()", "add up to 1"),
        ("np.cov(np.asarray(points, dtype=float).T)", "np.cov(points)", "of the shape (2,)"),
    ],
    "price_of_the_other": [
        ("np.sqrt(", "(", "take the root"),
        ("return np.sqrt(", "return 1 / np.sqrt(", "the other way round"),
        ("* np.diag(information)", "", "divide by the one with the other known"),
        (
            "np.diag(np.linalg.inv(information)) * np.diag(information)",
            "1 / np.diag(information)",
            "with the other known",
        ),
        ("np.diag(np.linalg.inv(information))", "1 / np.diag(information)", "the diagonal of F inverted"),
        ("np.diag(information)", "np.diag(information)[::-1]", "the factors are"),
        ("return", "information[0, 0]", "a factor for each unknown"),
        ("return np", "information *= 2; return np", "changes its argument"),
    ],
    "most_telling": [
        ("np.linalg.det(informations)", "np.trace(informations, axis1=1, axis2=2)", "the trace does not see this"),
        ("np.argmax", "np.argmin", "nothing at all"),
        ("np.argmax(np.linalg.det(informations))", "3", "another tells more"),
        ("return", "np.linalg.det(informations)", "a number of a motion"),
    ],
    "share_held": [
        ("-2 * np.log(0.1)", "1.645**2", "the radius is larger"),
        ("-2 * np.log(0.1)", "4 * np.log(0.1) ** 2", "not squared again"),
        ("np.mean(squared", "np.mean(np.sqrt(squared)", "has no root"),
        ("np.linalg.inv(covariances)", "covariances", "the inverse of the covariance"),
        (
            "body",
            "widths = 1.645 * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))\n"
            "return np.mean((np.abs(estimates - truths) <= widths).all(axis=1))",
            "an ellipse, no box",
        ),
        ("<=", ">", "of those outside"),
        (
            "np.linalg.inv(covariances)",
            "np.linalg.inv(np.tile([[4.0, 1.9], [1.9, 1.0]], (400, 1, 1)))",
            "its own covariance",
        ),
        ("np.mean(", "np.sum(", "the regions hold"),
    ],
    "point_of_pixel": [
        ("column + 0.5", "column", "that is"),
        (
            "body",
            "h, w = size; f = h / 2 / np.tan(np.deg2rad(fovy) / 2)\n"
            "return depth * np.array([(column - w / 2) / f, (h / 2 - row) / f, -1])",
            "half a pixel",
        ),
        ("(height / 2 - row - 0.5)", "(row + 0.5 - height / 2)", "rows count downwards"),
        ("-1.0]", "1.0]", "minus z axis"),
        ("depth * np.array([right, up, -1.0])", "np.array([right, up, -depth])", "grow with the depth"),
        ("return", "depth * np.array([right, up, -1.0]) / np.linalg.norm([right, up, 1.0])", "not along the ray"),
        ("focal = height", "focal = width", "not its width"),
        ("np.deg2rad(fovy) / 2", "np.deg2rad(fovy)", "half of fovy"),
        ("focal = height / 2 /", "focal = height /", "not all of it"),
        ("np.deg2rad(fovy) / 2", "fovy / 2", "takes radians"),
        ("return", "depth", "a point: right, up, backward"),
        ("up = (height / 2 - row - 0.5) / focal", "up = 0.0", "that is"),
    ],
    "plane_of_most": [
        (
            "body",
            "columns = np.column_stack([points[:, :2], np.ones(len(points))])\n"
            "return np.linalg.lstsq(columns, points[:, 2], rcond=None)[0]",
            "pulled up by what stands",
        ),
        ("return", "np.array([0.0, 0.0, np.median(points[:, 2])])", "a median height is no plane"),
        ("return", "np.append(fit.estimator_.coef_[::-1], fit.estimator_.intercept_)", "the other way round"),
        ("return", "np.append(fit.estimator_.intercept_, fit.estimator_.coef_)", "first the slopes"),
        ("return", "fit.estimator_.coef_", "a, b and c"),
        ("return", "np.array([0.0, 0.0, points[:, 2].min()])", "something else"),
    ],
    "choose_grasp": [
        ("apart[:, [0, 2]], axis=1", "apart[:, [2]], axis=1", "differ less ahead and up is better"),
        ("apart[:, [0, 2]], axis=1", "apart[:, [0]], axis=1", "count alike"),
        (
            "np.linalg.norm(apart[:, [0, 2]], axis=1)",
            "np.abs(apart[:, [0, 2]]).sum(axis=1)",
            "root of the sum of both squares",
        ),
        ("np.linalg.norm(apart[:, [0, 2]], axis=1)", "np.abs(apart[:, [0, 2]]).max(axis=1)", "the larger of the two"),
        ("np.linalg.norm(apart[:, [0, 2]], axis=1)", "np.linalg.norm(apart, axis=1)", "how wide the edge is"),
        ("axis=1) / 2", "axis=1)", "by half of what"),
        (" if off.min() <= reach else None", "", "return None"),
        ("<= reach", "<= 0.03", "use `reach`"),
        ("return", "off", "the number of an edge, or None"),
    ],
    "verdict": [
        ("sign * mean", "mean", "where its sign is -1"),
        ("return", "int(abs(mean) > half)", "return -1"),
        ("return", "sign * int(np.sign(mean))", "return 0"),
        ("/ np.sqrt(len(differences))", "", "root of their number"),
        ("stats.t.ppf(0.975, len(differences) - 1)", "1.96", "Student's t"),
        ("stats.t.ppf(0.975, len(differences) - 1)", "stats.t.ppf(0.95, len(differences) - 1)", "Student's t"),
        ("ddof=1", "ddof=0", "n - 1, not by n"),
        ("stats.t.ppf(0.975, len(differences) - 1)", "2.776", "one less than the values"),
        ("return", "mean > half", "return 1"),
        ("return", "sign * mean", "far above zero"),
    ],
    "best_of": [
        ("combinations(values, count)", "product(values, repeat=count)", "without putting back"),
        ("max(each)", "np.mean(each)", "single repeats"),
        ("return", "np.max(values)", "best of all"),
        ("max(each)", "min(each)", "smallest of each"),
        ("return", "max(values[:count])", "one choice among all"),
        ("np.mean([", "np.sum([", "take their mean"),
        ("return", "np.sort(values)[-count]", "have the mean"),
        ("return", "np.sort(values)[-count:].mean()", "have the mean"),
    ],
    "when_apart": [
        ("np.abs(a - b)", "(b - a)", "absolute difference"),
        ("return", "int(np.argmax(np.abs(a - b)))", "differ counts"),
        ("return", "int(far[-1]) if len(far) else None", "differ counts"),
        ("int(far[0])", "int(far[0]) + 1", "from 0 on"),
        ("> tolerance", "> 0.1", "use `tolerance`"),
        ("> tolerance", ">= tolerance", "still within it"),
        ("if len(far)", "if len(far) and far[0]", "0, not None"),
        (" if len(far) else None", "", "raised IndexError"),
        ("return", "np.abs(a - b)", "the number of a step, or None"),
    ],
    "way_left": [
        ("max(0.0, near + length - ahead)", "near + length - ahead", "not negative"),
        ("base + np.sqrt", "np.sqrt", "goes ahead with the base"),
        ("np.sqrt(reach**2 - (length - shoulder) ** 2)", "reach", "reaches less far"),
        ("near + length - ahead", "near - ahead", "a cloth's length beyond"),
        ("(length - shoulder) ** 2", "length**2", "not above the shoulder"),
        ("return", "ahead", "how far is it from there"),
        ("base + np.sqrt", "0.5 * base + np.sqrt", "are left"),
    ],
    "momentum_step": [
        ("momentum * v + gradient", "momentum * v + rate * gradient", "v collects the gradients as they are"),
        (
            "v = momentum * v + gradient\n    return p - rate * v, v",
            "v = momentum * v + rate * gradient; return p - v, v",
            "the rate belongs to the step of p",
        ),
        (
            "v = momentum * v + gradient\n    return p - rate * v, v",
            "v = momentum * v - rate * gradient; return p + v, v",
            "rate and minus belong",
        ),
        ("momentum * v + gradient", "momentum * v - gradient", "the minus belongs"),
        ("momentum * v + gradient", "gradient", "times the momentum"),
        ("momentum * v + gradient", "v + gradient", "only momentum times"),
        ("momentum * v + gradient", "momentum * (v + gradient)", "counts in full"),
        ("momentum * v + gradient", "momentum * v + (1 - momentum) * gradient", "running mean"),
        ("p - rate * v", "p - rate * gradient", "not by the last gradient alone"),
        ("p - rate * v", "p + rate * v", "uphill"),
        ("p - rate * v", "p - v", "rate times v"),
        ("p - rate * v, v", "p - rate * (momentum * v + gradient), v", "Nesterov"),
        ("p - rate * v", "-rate * v", "how far p moves"),
        ("return p - rate * v, v", "return p, v", "p does not move"),
        ("return p - rate * v, v", "return v, p - rate * v", "the new p first"),
        ("    return p - rate * v, v", "    return p - rate * v, (v - gradient) / momentum", "the old one"),
        ("body", "return p - rate * v, momentum * v + gradient", "by the new v, not by the old"),
        ("rate * v", "0.1 * v", "the new p is wrong"),
        ("momentum * v +", "0.9 * v +", "the new v is wrong"),
        ("v = momentum * v + gradient", "v *= momentum; v += gradient", "changes its argument `v`"),
        ("return p - rate * v, v", "p -= rate * v; return p, v", "changes its argument `p`"),
        ("return", "p - rate * v", "the new p and the new v"),
    ],
    "curvature": [
        ("/ np.linalg.norm(direction)", "", "divide the direction by its length"),
        ("/ epsilon**2", "/ epsilon", "what is it divided by"),
        ("- 2 * loss(p)", "- loss(p)", "counts twice"),
        ("- 2 * loss(p)", "+ 2 * loss(p)", "subtracted, not added"),
        ("- 2 * loss(p) + loss(p - step)", "- loss(p - step)", "second derivative"),
        (
            "(loss(p + step) - 2 * loss(p) + loss(p - step))",
            "(loss(p + 2 * step) - 2 * loss(p + step) + loss(p))",
            "not two steps on",
        ),
        ("step = ", "p = np.zeros(2); step = ", "not around the origin"),
        ("step = ", "epsilon = 0.1; step = ", "as far as you are told"),
        ("step = ", "epsilon = 1e-4; step = ", "as far as you are told"),
        ("/ np.linalg.norm(direction)", "/ np.abs(direction).sum()", "second derivative"),
    ],
    "steps_until_right": [
        ("wrong[-1] + 1", "wrong[-1]", "the last wrong one"),
        ("wrong[-1] + 1", "wrong[0] + 1", "not for good"),
        ("wrong[-1] + 1", "len(wrong)", "how often it was wrong"),
        (
            "return None if first == len(trace) else first",
            "return None if first == len(trace) else len(trace) - first",
            "how many pass before",
        ),
        ("None if first == len(trace) else first", "first", "must give None"),
        ("None if first == len(trace) else first", "first or None", "must give None"),
        ("first == len(trace)", "first >= len(trace) - 1", "right at its last step alone"),
        ("else 0", "else None", "must give 0"),
        ("return", "None", "must give a number"),
        ("nearest_material(p, biases) != name", "abs(p[0] - biases[name][0]) > 1", "how often it was wrong"),
        ("wrong[-1] + 1", "float(wrong[-1]) + 1.5", "from step 5, got 5.5"),
    ],
    "my_mask": [
        ("range(t + 1, t + horizon + 1)", "range(t, t + horizon)", "not of step t"),
        ("range(t + 1, t + horizon + 1)", "range(t + 1, t + period + 1)", "horizon = 8"),
        ("range(t + 1, t + horizon + 1)", "range(t + 1, t + 5)", "one number for each of the 8"),
        ("range(t + 1, t + horizon + 1)", "range(t + 1, t + horizon)", "one number for each of the 4"),
        ("% period", "% 4", "period = 3"),
        ("step % period == 0", "step % period != 0", "paper's example has [0, 1, 0, 0], got [1, 0, 1, 1]"),
        ("return", "[int(k == (period - t - 1) % period) for k in range(horizon)]", "a multiple of 3"),
        ("return", "(int(step % period == 0) for step in range(t + 1, t + horizon + 1))", "a list of 0 and 1"),
    ],
    "steps_along": [
        (" / np.linalg.norm(g)", "", "only its direction"),
        ("u - gammas", "u + gammas", "uphill"),
        ("np.linalg.norm(g)", "np.abs(g).sum()", "as long as its γ"),
        ("np.linalg.norm(g)", "np.linalg.norm(g, axis=1, keepdims=True)", "as long as its γ"),
        ("np.linalg.norm(g)", "0.5", "as long as its γ"),
        ("g / np.linalg.norm(g)", "np.sign(g) / 4", "another direction"),
        ("g / np.linalg.norm(g)", "g[::-1] / np.linalg.norm(g)", "another direction"),
        ("return", "u - gammas[:, None, None] * direction", "numpy.clip"),
        ("return", "np.clip(u - gammas[:, None, None] * direction, -1, 1)", "lower and the upper"),
        ("return", "np.minimum(u - gammas[:, None, None] * direction, upper)", "numpy.clip"),
        (
            "return",
            "np.array([d if np.all((lower < d) & (d < upper)) else u for d in u - gammas[:, None, None] * direction])",
            "only the commands that leave",
        ),
        ("gammas[:, None, None]", "gammas[0]", "one sequence of commands for each γ"),
        ("gammas[:, None, None]", "gammas[:2, None, None]", "one sequence of commands for each γ"),
        ("direction = ", "u -= 0; g /= 2; direction = ", "changes its argument `g`"),
    ],
    "alternate": [
        ("t // period % len", "t % len", "a a a b b b a"),
        ("references[t // period % len(references)]", "references[t // period]", "raised IndexError"),
        ("% len(references)", "% 2", "a b c a b c a"),
        ("// period", "// 3", "a b c a b c a"),
        ("t // period", "(t + 1) // period", "a a a b b b a"),
        ("references[t // period % len(references)]", "references[0]", "got a a a a a a a"),
        ("return policy(observation)", "return policy", "return a command"),
        ("return policy(observation)", "return policy(0.0)", "pass the observation on"),
        (
            "policy.z_ref = references[t // period % len(references)]",
            "u = policy(observation); policy.z_ref = references[t // period % len(references)]; t += 1; return u",
            "before the policy is asked",
        ),
        ("return call", "return call(0.0)", "return a policy"),
        ("nonlocal t", "pass", "raised UnboundLocalError"),
    ],
    "random_shooting": [
        (
            "candidates[np.argmin(predict_loss(candidates))]",
            "predict_loss(candidates).min()",
            "the best sequence of commands",
        ),
        ("[np.argmin(predict_loss(candidates))]", "", "of the shape (4, 2)"),
        ("candidates[0] = start", "pass", "the start is a sequence to try"),
        ("(count, *np.shape(start))", "(count + 1, *np.shape(start))", "was asked about 201"),
        ("predict_loss(candidates)", "predict_loss(candidates[0])", "a batch of sequences"),
        ("predict_loss(candidates)", "[predict_loss(u[None])[0] for u in candidates]", "200 calls"),
        ("rng.uniform(lower, upper,", "rng.uniform(-1, 1,", "left its range"),
        ("rng.uniform(lower, upper,", "start + rng.normal(0, 1,", "left its range"),
        ("rng.uniform(lower, upper,", "rng.uniform(lower / 2, upper / 2,", "the whole range"),
        ("candidates[0] = start", "candidates[:] = candidates[:, :1]; candidates[0] = start", "of its own"),
        ("argmin", "argmax", "the largest loss"),
        (
            "np.argmin(predict_loss(candidates))",
            "-1 + 0 * predict_loss(candidates).astype(int)[0]",
            "the last sequence",
        ),
        ("np.argmin(predict_loss(candidates))", "np.argsort(predict_loss(candidates))[1]", "has a lower loss"),
        ("return", "start", "was asked about 0"),
        ("return", "(predict_loss(candidates), start)[1]", "others were better"),
        ("candidates[0] = start", "candidates[:] = start", "yours are all the start"),
        ("candidates[0] = start", "candidates[:] = candidates[1]; candidates[0] = start", "commands of its own"),
        (
            "candidates[0] = start",
            "candidates[..., 1] = (candidates[..., 0] + 1) / 3 - 0.2; candidates[0] = start",
            "move together",
        ),
        (
            "candidates[0] = start",
            "candidates[:] = np.clip(rng.normal(0, 1, candidates.shape), lower, upper); candidates[0] = start",
            "draw uniformly",
        ),
        ("rng.uniform(lower, upper,", "rng.triangular(lower, (lower + upper) / 2, upper,", "draw uniformly"),
        ("candidates[0] = start", "start[:] = 0; candidates[0] = start", "changes its argument `start`"),
        ("rng.uniform", "np.random.uniform", "must draw the same sequences"),
        ("rng.uniform", "np.random.default_rng(0).uniform", "must draw other sequences"),
    ],
    "half_time": [
        (" * CONTROL_PERIOD", "", "3 is the number of steps"),
        ("distance < ", "distance <= ", "just half of the first"),
        ("distance[0] / 2", "distance.max() / 2", "just half of the first"),
        ("np.asarray(trace) - goal", "np.asarray(trace)", "on a path that reaches its goal"),
        ("below[0] *", "(below[-1]) *", "stays below"),
        ("below[0] *", "(below[0] + 1) *", "the first value"),
        (
            "below[0] * CONTROL_PERIOD, 1)) if len(below) else None",
            "below[0] * CONTROL_PERIOD, 1)) if len(below) else 0.0",
            "must give None",
        ),
        ("else None", "else np.nan", "returned nan: return a time in seconds, or None"),
        ("return", "None", "on a path that reaches its goal"),
    ],
    "averaged": [
        ("mean(axis=0)", "mean()", "of the shape (2,)"),
        ("mean(axis=0)", "mean(axis=1)", "of the shape (2,)"),
        ("[-n:]", "[:n]", "the first four"),
        ("[-n:]", "[:-n]", "all but the last four"),
        ("[-n:]", "[n:]", "all but the first four"),
        ("[-n:]", "[-n - 1 : -1]", "the last one belongs"),
        ("[-n:]", "[-1:]", "the last one alone"),
        ("[-n:]", "", "all of them"),
        ("mean(axis=0)", "sum(axis=0)", "their sum"),
        ("np.asarray(trace)[-n:].mean(axis=0)", "np.median(np.asarray(trace)[-n:], axis=0)", "the median"),
        ("mean(axis=0)", "sum(axis=0) / n", "divide by their number"),
        ("[-n:]", "[len(trace) - n :]", "n = 12 takes them all"),
        ("[-n:]", "[-min(n, len(trace) - 1) :]", "with just n estimates"),
    ],
    "shaken": [
        ("rng.normal(0.0, sigma, len(u))", "sigma", "not disturbed at all"),
        ("rng.normal(0.0, sigma, len(u))", "rng.normal(0.0, sigma)", "a number for each"),
        ("rng.normal(0.0, sigma, len(u))", "rng.uniform(-sigma, sigma, len(u))", "not 0.05 rad"),
        (
            "rng.normal(0.0, sigma, len(u))",
            "rng.uniform(-(3**0.5) * sigma, 3**0.5 * sigma, len(u))",
            "from a normal one",
        ),
        ("rng.normal(0.0, sigma, len(u))", "rng.normal(0.0, 0.1, len(u))", "not 0.05 rad"),
        ("rng.normal(0.0, sigma, len(u))", "rng.normal(0.0, sigma**2, len(u))", "σ²"),
        ("u + rng.normal(0.0, sigma, len(u))", "u * (1 + rng.normal(0.0, sigma, len(u)))", "not 0.05 rad"),
        ("rng.normal(0.0, sigma", "rng.normal(sigma, sigma", "the mean 0"),
        ("rng.normal", "np.random.normal", "use it, and no other"),
        (
            "u = policy(observation)",
            "rng = np.random.default_rng(len(str(observation)) + observation); u = policy(observation)",
            "the one that is handed over",
        ),
        ("u = policy(observation)", "u = policy(None)", "pass the observation on"),
        ("u = policy(observation)", "u = policy(observation); u += rng.normal(0.0, sigma, len(u))", "in place"),
        (
            "np.clip(u + rng.normal(0.0, sigma, len(u)), arm.command_lower, arm.command_upper)",
            "u + rng.normal(0.0, sigma, len(u))",
            "numpy.clip",
        ),
        (
            "np.clip(u + rng.normal(0.0, sigma, len(u)), arm.command_lower, arm.command_upper)",
            "np.minimum(u + rng.normal(0.0, sigma, len(u)), arm.command_upper)",
            "numpy.clip",
        ),
        (
            "np.clip(u + rng.normal(0.0, sigma, len(u)), arm.command_lower, arm.command_upper)",
            "np.clip(u, arm.command_lower, arm.command_upper) + rng.normal(0.0, sigma, len(u))",
            "numpy.clip",
        ),
    ],
    "honest": [
        ("return", "promises.copy()", "as they were"),
        ("return", "share * promises", "not towards 0"),
        ("return", "share * (promises - promises.mean())", "add the mean again"),
        ("1 - error**2 / promises.var()", "error**2 / promises.var()", "the other part"),
        ("1 - error**2 / promises.var()", "1 - error / promises.std()", "standard deviations don't"),
        ("share * (", "share**0.5 * (", "you took its root"),
        ("1 - error**2 / promises.var()", "promises.var() / (promises.var() + error**2)", "in it already"),
        ("max(0.0, 1 - error**2 / promises.var())", "1 - error**2 / promises.var()", "more than all of the spread"),
        ("promises.mean()", "5", "whatever it is"),
        ("error**2", "error", "2.56"),
        ("return", "promises[:1]", "four promises, four numbers"),
    ],
    "one_outcome": [
        ("k * missed / (1 + noise)", "k / (1 + noise)", "where is what was missed"),
        ("k * missed / (1 + noise)", "k * missed", "teaches less"),
        ("-0.5 *", "-1.0 *", "a half in its exponent"),
        ("(x - tried) ** 2", "np.abs(x - tried)", "squares the distance"),
        ("(x - tried) ** 2", "x**2", "not of all plans with 0"),
        ("1 - k**2 / (1 + noise)", "k**2 / (1 + noise)", "asked is what is left"),
        ("1 - k**2 / (1 + noise)", "1 - k / (1 + noise)", "k enters twice"),
        ("1 - k**2 / (1 + noise)", "1 - k**2", "left out of the variance"),
        ("1 - k**2 / (1 + noise)", "1 - missed * k**2 / (1 + noise)", "does not depend on what was missed"),
        ("1 - k**2 / (1 + noise)", "(1 - k**2 / (1 + noise)) ** 0.5", "asked is the variance"),
        ("return", "k * missed / (1 + noise)", "the mean and the share"),
    ],
    "practise_then_perform": [
        ("t < periods * period", "t <= periods * period", "stops after 25 steps"),
        ("t < periods * period", "t < periods", "stops after 3 steps"),
        ("t < periods * period", "True", "stops after 40 steps"),
        ("t < periods * period", "t != periods * period", "goes on performing"),
        ("periods * period", "periods * 8", "2 periods of 5 steps"),
        ("return policy(observation)", "return policy(t)", "pass the observation on"),
        ("return policy(observation)", "return -policy(observation)", "send what the policy says"),
        ("t = 0", "t = 0; policy(0)", "not before the first"),
    ],
    "falling_speed": [
        ("* 9.81", "", "where is g?"),
        ("sheets * sheet", "sheet", "number of sheets is left out"),
        ("* area", "", "a square metre"),
        ("* area", "* 0.2", "half as much"),
        ("* sheet.thickness", "", "how thick"),
        ("sheet.density * ", "", "what is its mass"),
        ("/ drag", "/ (18 * drag)", "of the whole cloth"),
        ("/ drag", "* 18 / drag", "so must the mass be"),
        ("/ drag", "* drag", "make it slower"),
        ("return", "drag / (sheets * sheet.density * sheet.thickness * area * 9.81)", "upside down"),
        ("return", "(sheets * sheet.density * sheet.thickness * area * 9.81 / drag) ** 0.5", "not with its square"),
        ("return ", "return -", "positive"),
        ("9.81", "10", "falls at"),
    ],
    "place": [
        ("/ (axis @ axis)", "/ np.sqrt(axis @ axis)", "that is a distance"),
        ("/ (axis @ axis)", "", "once more"),
        ("return", "abs((p - start) @ axis) / (axis @ axis)", "has a place below 0"),
        ("(p - start) @ axis", "p @ axis", "of the way got"),
        ("(p - start) @ axis", "(end - p) @ axis", "0 is at the start"),
        ("return", "float((p - start)[0] / axis[0])", "project first"),
        ("return", "np.linalg.norm(p - start) / np.linalg.norm(axis)", "project first"),
        ("return", "np.clip((p - start) @ axis / (axis @ axis), 0, 1)", "beyond the end"),
        ("return", "(p - start) / axis", "return one number"),
        ("axis = end - start", "p -= start; start = 0 * p; axis = end - start", "changes its argument `p`"),
    ],
    "sign_flip_share": [
        (">= d.mean() - 1e-12", "> d.mean() + 1e-12", "count them too"),
        (">= d.mean() - 1e-12", ">= d.mean()", "within 1e-12"),
        (">= d.mean() - 1e-12", "< d.mean() - 1e-12", "with a smaller mean"),
        ("np.array(means) >= d", "np.abs(means) >= d", "not those that are as far from 0"),
        ("float(np.mean(", "float(np.sum(", "divide by how many there are"),
        ("float(np.mean(", "float(100 * np.mean(", "per cent"),
        (
            "for signs in product((1, -1), repeat=len(d))",
            "for signs in np.random.default_rng(0).choice([1, -1], (50, len(d)))",
            "1 choice of 8",
        ),
        ("d = np.asarray(differences)", "differences.sort(reverse=True); d = np.asarray(differences)", "in place"),
    ],
    "in_time": [
        ("<= period", "< period", "is in time"),
        ("<= period", "> period", "late steps"),
        ("<= period", "<= 0.2", "with a period of 0.1 s"),
        ("np.mean(", "np.sum(", "divide by how many"),
        ("np.mean(", "100 * np.mean(", "per cent"),
        ("return", "float(np.mean(seconds) <= period)", "by itself"),
        ("return", "(seconds <= period).mean()", "raised TypeError"),
        ("return", "0.75", "no step is late"),
    ],
    "nearest_phase": [
        ("return", "int(np.argmin(distances))", "from the start of the run"),
        ("return", "int(np.argmin(distances[:whole])) % period", "one near step"),
        ("return", "int(np.argmin([np.mean(distances[k::period]) for k in range(period)]))", "over whole periods"),
        (
            "whole = len(distances) // period * period",
            "whole = (len(distances) - 1) // period * period",
            "the last period is a whole one",
        ),
        ("return", "int(np.argmin(distances[whole - period : whole]))", "decides nothing"),
        (".mean(axis=0)", ".min(axis=0)", "one near step"),
        (".mean(axis=0)", "[0]", "one near step"),
        (
            "int(np.reshape(distances[:whole], (-1, period)).mean(axis=0).argmin())",
            "np.reshape(distances[:whole], (-1, period)).mean(axis=0).min()",
            "at which step",
        ),
        (".argmin()", ".argmin() + 1", "count from 0"),
        (".argmin()", ".argmax()", "where it is farthest"),
        (".mean(axis=0)", ".mean(axis=1)", "the nearest period"),
        ("return", "np.reshape(distances, (-1, period)).mean(axis=0).argmin()", "raised ValueError"),
        ("whole = ", "period = 5; whole = ", "at step 5"),
    ],
}


# Other ways to be right, and as readers write them: the solution with one piece replaced by another.
RIGHTS = {
    "best_moment": [
        ("body", "return float(min(range(skip, len(distance)), key=lambda k: distance[k])) / 5"),
        ("return", "np.float32(0.2) * (skip + np.asarray(distance, np.float32)[skip:].argmin())"),
        ("return", "np.round(0.2 * (skip + np.argmin(distance[skip:])), 1)"),
    ],
    "share_won": [
        ("return", "sum(bool(x < y) for x, y in zip(best_a, best_b, strict=True)) / (len(a) // period)"),
        ("return", "np.float32(np.mean(best_b > best_a))"),
    ],
    "count_springs": [
        ("return", "[float(structural), np.int64(shear), bending]"),
        ("return", "np.array([structural, shear, bending], np.float32)"),
    ],
    "time_to_reach": [
        ("return", "[cloth.point_mass / cloth.damping * np.log(1 / (1 - share))][0]"),
        ("np.log(1 - share)", "np.log(np.float32(1 - share))"),
        ("return", "1e-4 * np.argmax((1 - 1e-4 * cloth.damping / cloth.point_mass) ** np.arange(10000) <= 1 - share)"),
    ],
    "euler_step": [
        ("return", "[x + dt * v, v]"),
        ("return", "np.stack([x + dt * v, v])"),
        ("return", "(x + dt * v).tolist(), v.astype(np.float32)"),
        ("v[: cloth.columns] = 0.0", "v = np.vstack([np.zeros((3, 3)), v[3:]])"),
    ],
    "pair_stiffness": [
        ("e0**2", "e0 * e0 * np.float32(1)"),
        ("body", "f = lambda q: r * (k1 * (e0 + r * q) + k3 * (e0 + r * q) ** 3); return (f(1e-4) - f(-1e-4)) / 1e-4"),
    ],
    "compliance": [
        ("return", "(J @ np.linalg.solve(k * G.T @ G, J.T)).tolist()"),
        ("return", "(J @ np.linalg.inv(G.T @ np.diag(np.full(6, k)) @ G) @ J.T).astype(np.float32)"),
    ],
    "length_for_measured_tension": [
        (
            "body",
            "back = (f - arm.tension_bias) / arm.motor_stiffness; return list(arm.body_image(theta_ref, f) - back)",
        ),
        (
            "body",
            "return theta_ref @ arm.moment_arms.T - arm.elongation(f) - (f - arm.tension_bias) / arm.motor_stiffness",
        ),
    ],
    "transitions": [
        ("return", "[trial.robot[:-1], trial.commands[:-1].tolist(), trial.robot[1:].astype(np.float32)]"),
        (
            "return",
            "tuple(zip(*[(trial.robot[t], trial.commands[t], trial.robot[t + 1]) for t in range(len(trial) - 1)]))",
        ),
    ],
    "wave": [
        ("return lambda observation:", "return lambda observation=None, *more:"),
        ("np.sin(next(angles))", "np.float32(np.sin(next(angles)))"),
        (
            "(lower + upper) / 2 + (upper - lower) / 2 * np.sin(next(angles))",
            "[(a + b + (b - a) * np.sin(k)) / 2 for k in [next(angles)] for a, b in zip(lower, upper)]",
        ),
    ],
    "take_turns": [
        ("return", "lambda _: list([first, second][next(steps) % (2 * every) >= every](_).astype(np.float32))"),
        (
            "body",
            "import itertools\nturns = itertools.cycle([first] * every + [second] * every)\n"
            "return lambda observation: next(turns)(observation)",
        ),
    ],
    "handmade": [
        ("return", "[mask.sum(), columns.mean(), rows.mean()]"),
        ("return", "len(rows), np.average(columns), sum(rows) / np.float32(len(rows))"),
    ],
    "linear_reconstruction": [
        ('svd_solver="randomized"', 'svd_solver="full"'),
        ("astype(np.float32)", "astype(float)"),
        (
            "body",
            "mean = train.mean(axis=0).ravel()\n"
            "a = np.linalg.svd(train.reshape(len(train), -1) - mean, False)[2][:components]\n"
            "return (mean + (images.reshape(len(images), -1) - mean) @ a.T @ a).reshape(images.shape).tolist()",
        ),
    ],
    "chamfer_by_hand": [
        (
            "body",
            "a, b = np.argwhere(a).tolist(), np.argwhere(b).tolist()\n"
            "mean = lambda a, b: sum(min(np.hypot(p[0] - q[0], p[1] - q[1]) for q in b) for p in a) / len(a)\n"
            "return (mean(a, b) + mean(b, a)) / 2",
        ),
        ("return (distances", "return np.float32(distances"),
    ],
    "lstm_weights": [
        ("return", "np.float32(4 * units * (inputs + units + 2))"),
        ("body", "return sum(w.numel() for w in torch.nn.LSTM(inputs, units).parameters())"),
    ],
    "extrapolate": [
        ("return", "[2 * b - a for a, b in zip(s[:-2], s[1:-1])]"),
        ("return", "(s[1:-1] + np.diff(s, axis=0)[:-1]).astype(np.float32)"),
        ("return", "torch.tensor(2 * s[1:-1] - s[:-2])"),
    ],
    "influence": [
        ("u.clone().requires_grad_()", "u.requires_grad_()"),
        ("gradient.norm(dim=1)", "[float(row.norm()) for row in gradient]"),
        ("torch.autograd.grad(z.square().sum(), u)", "torch.autograd.grad((z * z).sum(), u, create_graph=True)"),
        ("(gradient,) = torch.autograd.grad(z.square().sum(), u)", "z.pow(2).sum().backward(); gradient = u.grad"),
        (
            "body",
            "f = lambda w: predict(model, s, w[None], p, memory)[0, -1, :3].square().sum()\n"
            "e = 1e-2 * torch.eye(u.numel()).reshape(-1, *u.shape)\n"
            "return torch.stack([f(u + d) - f(u - d) for d in e]).reshape(u.shape).norm(dim=1) / 2e-2",
        ),
    ],
    "matching_drag": [
        ("return", "np.float32(cloth.damping) * mass / cloth.mass"),
        ("return", "9.81 * mass / (cloth.rows * cloth.columns) / cloth.terminal_speed"),
    ],
    "shares_by_hand": [
        ("body", "s = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) ** 2; return list(s / s.sum())"),
        (
            "body",
            "e = np.sort(np.linalg.eig(np.cov(points, rowvar=False))[0])[::-1]; return (e / sum(e)).astype(np.float32)",
        ),
    ],
    "price_of_the_other": [
        ("body", "(a, b), (_, c) = information; return 2 * [(1 - b * b / (a * c)) ** -0.5]"),
        ("return", "np.float32(np.sqrt(np.diag(np.linalg.inv(information)) * np.diag(information)))"),
    ],
    "most_telling": [
        ("body", "return max(range(len(informations)), key=lambda k: np.linalg.det(informations[k]))"),
        ("body", "return np.prod(np.linalg.eigvalsh(informations), axis=1).argmax()"),
    ],
    "share_held": [
        ("-2 * np.log(0.1)", "4.60517"),
        (
            "body",
            "held = [d @ np.linalg.solve(c, d) <= 4.605 for d, c in zip(estimates - truths, covariances)]\n"
            "return sum(held) / len(held)",
        ),
    ],
    "momentum_step": [
        ("return", "[(p - rate * v).tolist(), v.astype(np.float32)]"),
        ("return", "np.stack([p - rate * v, v])"),
        ("return", "(tuple(a - rate * b for a, b in zip(p, v)), torch.tensor(v))"),
    ],
    "curvature": [
        ("/ epsilon**2", "/ np.float32(epsilon**2)"),
        (
            "body",
            "d = epsilon * direction / np.hypot(*direction)\n"
            "return np.diff([loss(p + k * d) for k in (-1, 0, 1)], 2)[0] / epsilon**2",
        ),
    ],
    "steps_until_right": [
        ("else first", "else np.float32(first)"),
        (
            "body",
            "far = np.linalg.norm(trace[:, None] - np.array(list(biases.values())), axis=-1).argmin(axis=1)\n"
            "right = far == list(biases).index(name); n = len(trace) - np.cumprod(right[::-1]).sum()\n"
            "return n if right[-1] else None",
        ),
    ],
    "my_mask": [
        ("int(step % period == 0)", "step % period == 0"),
        ("return", "(np.arange(t + 1, t + horizon + 1) % period == 0).astype(np.float32)"),
        ("return", "tuple(0 if step % period else 1 for step in range(t + 1, t + horizon + 1))"),
    ],
    "steps_along": [
        (
            "return",
            "[np.minimum(np.maximum(u - gamma * direction, lower), upper).astype(np.float32) for gamma in gammas]",
        ),
        ("np.linalg.norm(g)", "np.sqrt((g**2).sum())"),
        ("gammas[:, None, None] * direction", "np.einsum('b,tu->btu', gammas, direction)"),
    ],
    "alternate": [
        ("return call", "return lambda observation, *more: np.float32(call(observation))"),
        ("t = 0", "t, references = 0, torch.stack(references)"),
        ("t = 0", "t, references = 0, np.stack(references)"),
        (
            "body",
            "steps = __import__('itertools').cycle([z for z in references for _ in range(period)])\n"
            "return lambda observation: (setattr(policy, 'z_ref', next(steps)), policy(observation))[1]",
        ),
    ],
    "random_shooting": [
        ("candidates[0] = start", "candidates[-1] = start"),
        ("rng.uniform(lower, upper, (count, *np.shape(start)))", "lower + (upper - lower) * rng.random((count, 4, 2))"),
        ("return", "list(candidates[np.argsort(predict_loss(list(candidates)))[0]])"),
        (
            "body",
            "others = rng.uniform(lower, upper, (count - 1, *start.shape)).astype(np.float32)\n"
            "both = np.concatenate([others, start[None]]); return both[predict_loss(both).argmin()]",
        ),
    ],
    "half_time": [
        ("return", "np.float32(0.2) * below[0] if below.any() else None"),
        (
            "body",
            "far = [((x - goal[0]) ** 2 + (y - goal[1]) ** 2) ** 0.5 for x, y in trace]\n"
            "return next((k / 5 for k, d in enumerate(far) if d < far[0] / 2), None)",
        ),
    ],
    "averaged": [
        ("return", "[sum(column) / len(column) for column in zip(*trace[-n:])]"),
        ("return", "torch.tensor(trace[-n:]).float().mean(dim=0)"),
        ("return", "np.average(trace[max(0, len(trace) - n) :], axis=0)"),
    ],
    "shaken": [
        ("return call", "return lambda observation, *more: list(call(observation).astype(np.float32))"),
        ("rng.normal(0.0, sigma, len(u))", "sigma * rng.standard_normal(2)"),
        ("u = policy(observation)", "u = np.array(policy(observation)); u += 0"),
    ],
    "honest": [
        (
            "body",
            "m = sum(promises) / len(promises); v = sum((x - m) ** 2 for x in promises) / len(promises)\n"
            "return [m + max(v - error**2, 0) / v * (x - m) for x in promises]",
        ),
        ("return", "torch.tensor(promises.mean() + share * (promises - promises.mean()))"),
    ],
    "one_outcome": [
        ("return", "[np.float32(k * missed / (1 + noise)), torch.tensor(1 - k * k / (1 + noise))]"),
        ("return", "missed * k / (1 + noise), 1 - k @ np.diag(k) / (1 + noise)"),
    ],
    "practise_then_perform": [
        ("t < periods * period", "t // period < periods"),
        ("policy.practising = t < periods * period", "policy.practising &= t < periods * period"),
    ],
    "falling_speed": [
        ("9.81", "9.80665"),
        ("return", "np.float32(sheets * sheet.density * sheet.thickness * area) * np.float32(9.81) / np.float32(drag)"),
    ],
    "place": [
        ("return", "np.float32(np.dot(p - start, end - start) / np.linalg.norm(end - start) ** 2)"),
        ("return", "np.linalg.lstsq(axis[:, None], p - start)[0].item()"),
        ("return", "torch.tensor((p - start) @ axis / (axis @ axis))"),
    ],
    "sign_flip_share": [
        (
            "return",
            "np.float32((np.array(list(product((-1, 1), repeat=len(d)))) @ d / len(d) > d.mean() - 1e-12).mean())",
        ),
        ("(1, -1)", "(1, 0)"),  # a sign that is lost lowers the mean by half as much as one that is turned
        ("return", "sum(sum(signs * d) >= sum(d) - 1e-12 for signs in product((1, -1), repeat=len(d))) / 2 ** len(d)"),
    ],
    "in_time": [
        ("return", "sum(s <= period for s in seconds) / len(seconds)"),
        ("return", "np.float32(np.mean([s <= period for s in seconds]))"),
    ],
    "nearest_phase": [
        ("return", "np.float32(np.argmin([np.mean(distances[k:whole:period]) for k in range(period)]))"),
        ("return", "min(range(period), key=lambda k: sum(distances[k:whole:period]))"),
    ],
}


def replaced(name, old, new):
    """The solution of an exercise with another piece in it."""
    solution = EXERCISES[name][2]
    if old == "body":
        (function,) = functions(solution)
        function.body = ast.parse(new).body
        module = ast.Module([ast.FunctionDef(**vars(function))], [])
        return define(name, ast.unparse(ast.fix_missing_locations(module)))
    assert old in solution, "the solution has changed: change this row of the table, too"
    if old == "return":
        old = solution[solution.rindex("return ") + len("return ") :]
    return define(name, solution.replace(old, new))


@pytest.mark.parametrize(
    ("name", "right", "wrong", "told"), [(name, *slip) for name, slips in SLIPS.items() for slip in slips]
)
def test_a_slip_is_refused_and_named(name, right, wrong, told, capsys):
    with pytest.raises(checks.CheckFailed, match=re.escape(told)):
        getattr(checks, name)(replaced(name, right, wrong))
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("name", "old", "new"), [(name, *other) for name, others in RIGHTS.items() for other in others]
)
def test_another_way_to_be_right_is_accepted(name, old, new, capsys):
    getattr(checks, name)(replaced(name, old, new))
    assert capsys.readouterr().out == "correct\n"


def test_every_check_has_met_a_slip():
    assert set(SLIPS) == set(EXERCISES)


def test_a_check_wants_the_function_itself():
    with pytest.raises(checks.CheckFailed, match="the function wave itself"):
        checks.wave(None)


ODD = [None, "three", b"3", float("nan"), np.inf, 1j, (), (1,), range(9), [[1], [2, 3]], {"a": 1}, {1}, object(), dict]
ODD += [np.array("three"), np.full(2, np.nan), np.zeros((2, 2, 2, 2)), torch.full((3,), torch.nan), ValueError("odd")]
ODD += [lambda *args, **kwargs: None, (k for k in range(3)), np.array([None, 1.0]), ["1", "2"], (np.zeros(2), None)]
POLICIES = {"wave", "take_turns", "alternate", "shaken", "practise_then_perform"}


def fails(*args, **kwargs):
    raise ZeroDivisionError("in the answer")


def turning(solution, calls, then):
    """An answer that is right for so many calls, and something else from then on."""
    right = iter([solution] * calls)
    return lambda *args, **kwargs: next(right, then)(*args, **kwargs)


def calls_of(name):
    """How often a check calls its solution."""
    solution, calls = define(name, EXERCISES[name][2]), []
    getattr(checks, name)(lambda *args, **kwargs: calls.append(1) or solution(*args, **kwargs))
    return len(calls)


@pytest.mark.parametrize("name", EXERCISES)
def test_whatever_an_answer_returns_is_refused_in_a_sentence(name, capsys):
    for odd in ODD:
        for answer in (lambda *args, odd=odd, **kwargs: odd, lambda *args, odd=odd, **kwargs: lambda observation: odd):
            with pytest.raises(checks.CheckFailed, match=r"\w \w") as refused:
                getattr(checks, name)(answer)
            assert "\n" not in str(refused.value)
            assert len(str(refused.value)) < 250
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("name", EXERCISES)
def test_whenever_an_answer_goes_wrong_it_is_refused_in_a_sentence(name):
    solution = define(name, EXERCISES[name][2])
    for calls in range(calls_of(name)):
        with pytest.raises(checks.CheckFailed, match=f"{name} raised ZeroDivisionError: in the answer"):
            getattr(checks, name)(turning(solution, calls, fails))
        with pytest.raises(checks.CheckFailed, match=f"{name} returned 'three': return"):
            getattr(checks, name)(turning(solution, calls, lambda *args, **kwargs: "three"))


@pytest.mark.parametrize("name", sorted(POLICIES))
@pytest.mark.parametrize("calls", [0, 1, 5])
def test_whenever_a_policy_goes_wrong_it_is_refused_in_a_sentence(name, calls):
    solution = define(name, EXERCISES[name][2])
    for then, told in ((fails, "raised ZeroDivisionError: in the answer"), (lambda observation: "up", "returned 'up'")):
        with pytest.raises(checks.CheckFailed, match=f"the policy of {name} {told}"):
            getattr(checks, name)(lambda *args, **kw: turning(solution(*args, **kw), calls, then))  # noqa: B023


@pytest.mark.parametrize(
    "name", sorted(set(EXERCISES) - {"choose_grasp", "half_time", "steps_until_right", "when_apart"})
)
def test_a_stub_is_told_that_it_returned_none(name):
    with pytest.raises(checks.CheckFailed, match=f"{name} returned None: return"):
        getattr(checks, name)(define(name, EXERCISES[name][1]))


@pytest.mark.parametrize("error", [AssertionError("no"), KeyError("p"), StopIteration(), RuntimeError("two\nlines")])
def test_every_error_of_an_answer_is_named(error):
    def answer(*args, **kwargs):
        raise error

    with pytest.raises(checks.CheckFailed, match=f"best_moment raised {type(error).__name__}.*`raise error`"):
        checks.best_moment(answer)


def test_arguments_in_another_number_are_told_as_python_tells_them():
    with pytest.raises(checks.CheckFailed, match=r"best_moment raised TypeError: .*unexpected keyword argument 'skip'"):
        checks.best_moment(lambda distance: 0.0)


def test_an_error_of_a_check_itself_is_not_taken_for_the_answers():
    @check(number("a number"))
    def faulty(answer):
        return {}[answer()]

    with pytest.raises(KeyError):
        faulty(lambda: 1)


@pytest.mark.parametrize(
    ("given", "change"),
    [
        ([2, 1], list.sort),
        ([np.array([2, 1])], lambda x: x[0].sort()),
        ({"p": np.array([2, 1])}, lambda x: x["p"].sort()),
        ({"p": 1}, dict.clear),
        (np.array([2, 1]), np.ndarray.sort),
        (torch.tensor([2, 1]), torch.Tensor.zero_),
    ],
)
def test_an_answer_must_not_change_what_it_was_given(given, change):
    @check(number("a number"))
    def compare(answer):
        answer(given)

    compare(lambda x: len(x))
    with pytest.raises(checks.CheckFailed, match="changes its argument `x` in place: work on a copy"):
        compare(lambda x: bool(change(x) is x))


@pytest.mark.parametrize("found", [2, 2.0, np.float32(2), np.int64(2), np.array(2), torch.tensor(2.0), Fraction(2)])
def test_a_number_of_any_kind_is_a_number(found):
    assert number("a number")("f", found) == 2.0


@pytest.mark.parametrize("found", [(1, 2), [True, 2], np.array([1, 2], np.float32), torch.tensor([1, 2]), range(1, 3)])
def test_an_array_of_any_kind_is_an_array(found):
    assert array("two numbers", 2)("f", found).tolist() == [1.0, 2.0]
