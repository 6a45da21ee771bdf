"""Exercises: a stub, its solution, and a check that refuses wrong answers and says why."""

import ast
import copy
import linecache
import re
import sys
from fractions import Fraction
from functools import cache
from itertools import product
from pathlib import Path

import nbformat
import numpy as np
import pytest
import torch
from solutions import solved
from threadpoolctl import threadpool_limits

import clothlab
from clothlab import checks
from clothlab.checks import ask
from clothlab.checks._check import array, check, expect, number
from clothlab.checks.ask import Unanswered
from clothlab.simulation.cloth import get_cloth, hanging_points

NOTEBOOKS = sorted((Path(clothlab.__file__).parents[1] / "notebooks").glob("*.ipynb"))
SPRINGS = {"structural": [(1, 0), (0, 1)], "shear": [(1, 1), (1, -1)]}
SPRINGS |= {"bending": [(2, 0), (0, 2)]}


def pairs_of_springs(kind, rows=6, columns=3):
    for down, right in SPRINGS[kind]:
        for i, j in product(range(rows), range(columns)):
            if 0 < i + down < rows and 0 <= j + right < columns:
                yield (i, j), (i + down, j + right)


LESSONS = {  # what solutions take from their lesson
    "NEIGHBOURS": SPRINGS,
    "springs": pairs_of_springs,
    "start": hanging_points(get_cloth("damp0.05-mass0.10")),
}
DRAWS = range(5)  # seeds: each of them draws other inputs
LENT = {  # functions of their lesson that solutions call
    "infer": ("descend", "h", "mismatch")
}


@pytest.fixture(autouse=True, scope="module")
def one_core():
    """The principal axes of a few small images take ten times as long on two cores that
    are busy.
    """
    with threadpool_limits(1):
        yield


@pytest.fixture(autouse=True)
def inputs(monkeypatch):
    """Each test has the same inputs in each run; one below draws many."""
    monkeypatch.setenv("CLOTHLAB_CHECK_SEED", "7")


@cache
def code_cells(path):
    """Tags and source of the code cells, in order."""
    return [
        (set(cell.metadata.get("tags", [])), cell.source)
        for cell in solved(nbformat.read(path, as_version=4)).cells
        if cell.cell_type == "code"
    ]


@cache
def opening(path, names):
    """The imports of a notebook, and its functions with these names, to be run."""
    nodes = [node for _, cell in code_cells(path) for node in ast.parse(cell).body]
    kept = [
        node
        for node in nodes
        if isinstance(node, ast.Import | ast.ImportFrom)
        or (isinstance(node, ast.FunctionDef) and node.name in names)
    ]
    return compile(ast.Module(kept, []), str(path), "exec")


def tagged(path, tag):
    return [source for tags, source in code_cells(path) if tag in tags]


def functions(source):
    return [
        node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)
    ]


def signatures(source):
    return [
        (node.name, ast.unparse(node.args), ast.get_docstring(node))
        for node in functions(source)
    ]


def exercises():
    """Each exercise by its function's name: its notebook, stub and solution."""
    found = {}
    for path in NOTEBOOKS:
        for stub, solution in zip(
            tagged(path, "stub"), tagged(path, "solution"), strict=True
        ):
            name = functions(stub)[0].name
            assert name not in found, (
                f"{path.stem} has a second exercise called {name}: checks go by their names"
            )
            found[name] = path, stub, solution
    return found


EXERCISES = exercises()


def define(name, source):
    """The function as the notebook's reader would have it: after the notebook's
    imports.
    """
    namespace = dict(LESSONS)
    exec(opening(EXERCISES[name][0], LENT.get(name, ())), namespace)
    code = "\n".join(ast.unparse(node) for node in functions(source))
    file = f"<{name} {hash(code)}>"
    # As a kernel does for its cells
    linecache.cache[file] = (len(code), None, code.splitlines(keepends=True), file)
    exec(compile(code, file, "exec"), namespace)
    return namespace[name]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_an_exercise_has_stub_solution_and_check(path):
    cells = code_cells(path)
    stubs = [k for k, (tags, _) in enumerate(cells) if "stub" in tags]
    assert len(stubs) == len(tagged(path, "solution"))
    for k in stubs:
        (_, stub), (tags, solution), (_, check) = cells[k : k + 3]
        assert "solution" in tags, "the solution follows its stub"
        assert signatures(stub) == signatures(solution)
        (name, *_), *others = signatures(stub)
        assert not others, "one function to an exercise"
        assert check.startswith(f"checks.{name}({name})"), (
            f"the check of {name} is clothlab.checks.{name}"
        )
        assert (
            getattr(checks, name).__module__
            == f"clothlab.checks._{path.stem.partition('_')[2]}"
        )


def test_every_check_belongs_to_an_exercise():
    assert set(checks.__all__) - {"CheckFailed", "if_open"} == set(EXERCISES)


@pytest.mark.parametrize("name", EXERCISES)
def test_stubs_are_refused_and_solutions_are_not(name, capsys):
    _, stub, solution = EXERCISES[name]
    with pytest.raises(
        Unanswered,
        match=rf"^unanswered: the dots of {name} are still there, in `.*\.\.\..*`$",
    ):
        getattr(checks, name)(define(name, stub))
    assert capsys.readouterr().out == ""
    getattr(checks, name)(define(name, solution))
    assert capsys.readouterr().out == "correct\n"


# Slips that a check finds in another way than by comparing numbers: of the solution of an
# exercise `right` is replaced by `wrong`, and this the reader is told. Where `right` is
# "return", `wrong` is what the last line returns instead; where it is "body", all that it
# does.
SLIPS = [
    ("start_bright", "fill_(logit)", "add_(logit)", "don't add it"),
    ("start_bright", "last.bias", "last.weight", "nothing has changed"),
    ("update", "p[k]", "p", "k says which"),
    ("update", " / network.s_std", "", "divided by its standard deviation"),
    ("update", "optimizer.zero_grad()", "pass", "add up until"),
    ("update", "optimizer.step()", "pass", "nothing has moved"),
    ("update", "loss.backward()", "(-loss).backward()", "L rises"),
    ("update", "p[k]", "p[k].detach()", "L must know p"),
    ("closed_loop", "p, memory)", "p)", "pass the memory on"),
    ("infer", "[p]", "list(W.parameters())", "moves the weights of `W`"),
    ("heavier_twin", "mass=factor", "length=1.0, mass=factor", "cut alike"),
    (
        "my_mask",
        "settings.horizon + 1)",
        "settings.period + 1)",
        "one for each predicted step",
    ),
    ("my_mask", "range(t + 1, t +", "range(t, t - 1 +", "not of step t"),
    ("step_down", "gammas[:, None, None]", "gammas[0]", "of the shape (4, 8, 2)"),
    ("moved_on", "torch.cat([plan[1:], plan[-1:]])", "plan[1:]", "as many as before"),
    ("moved_on", "plan[-1:]]", "0 * plan[-1:]]", "the gap is filled"),
    ("verdict", "np.sign(mean)", "np.abs(np.sign(mean))", "return -1"),
    ("verdict", "abs(mean) > half", "True", "nothing is known"),
    ("verdict", "abs(mean) + half <= margin", "False", "no difference that matters"),
    ("verdict", "abs(mean) + half <= margin", "abs(mean) <= margin", "is not enough"),
    (
        "verdict",
        "abs(mean) + half <= margin",
        "abs(mean) + half <= margin and abs(mean) < half",
        "look at the margin first",
    ),
    (
        "verdict",
        "abs(mean) + half <= margin",
        "0 < mean + half <= margin",
        "both sides",
    ),
    ("verdict", "/ np.sqrt(len(numbers))", "", "root of their number"),
    ("verdict", "stats.t.ppf(0.975, len(numbers) - 1)", "1.96", "Student's t"),
    ("verdict", "ddof=1", "ddof=0", "n - 1, not by n"),
    (
        "verdict",
        "stats.t.ppf(0.975, len(numbers) - 1)",
        "2.776",
        "one less than the values",
    ),
]
# Other ways to be right, as readers write them: the solution with one piece replaced by
# another.
RIGHTS = [
    (
        "start_bright",
        "last.bias.fill_(logit)",
        "nn.init.constant_(list(network.parameters())[-1], logit)",
    ),
    ("closed_loop", "torch.stack(states, dim=1)", "torch.cat(states)[None]"),
    ("heavier_twin", "mass=factor * cloth.mass", "mass=cloth.mass * factor"),
    ("bare_step", "np.linalg.solve(J.T @ J, J.T @ e)", "np.linalg.lstsq(J, e)[0]"),
    ("update", "error.square().mean()", "(error**2).mean()"),
    ("update", "return loss.item()", "return loss"),
    ("online", "momentum * b + g", "g + b * momentum"),
    ("explicit_step", "d / k", "(d / m) / (k / m)"),
    ("stable_step", "2 / omega", "np.sqrt(4 / omega**2)"),
    ("cell_half_life", "return", "-1 / np.log2(phi)"),
    ("curvature", "return curvatures", "return curvatures.tolist()"),
    ("largest_rate", "2 * (1 + momentum)", "(momentum + 1) * 2.0"),
    ("same_predictions", "np.linalg.inv(A)", "np.linalg.pinv(A)"),
    ("two_link_jacobian", "return", "(np.stack([of_upper + of_fore, of_fore]).T)"),
    ("sag", "np.linalg.solve(joints, torque)", "np.linalg.inv(joints) @ torque"),
    ("compliance", "return", "(J @ np.linalg.solve(joints, J.T)).tolist()"),
    ("falling_speed", "(1 - np.exp(-t * c / m))", "-np.expm1(-c / m * t)"),
    ("infer", "0.05, 150", "0.1, 200"),
    (
        "my_mask",
        "return",
        "tuple(0 if step % settings.period else 1 for step in steps)",
    ),
    ("together", "return", "z(u + a + b) - z(u + a) - z(u + b) + z(u)"),
    ("moved_on", "return", "plan[[*range(1, len(plan)), -1]]"),
    ("step_down", "return", "torch.stack([u - k * sigma * direction for k in gammas])"),
    (
        "one_outcome",
        "return",
        "[np.float32(k * missed / (1 + noise)), torch.tensor(1 - k * k / (1 + noise))]",
    ),
    ("sign_flip_share", "(1, -1)", "(1, 0)"),
]


def replaced(name, old, new):
    """The solution of an exercise with another piece in it."""
    solution = EXERCISES[name][2]
    if old == "body":
        (function,) = functions(solution)
        function.body = ast.parse(new).body
        module = ast.Module([ast.FunctionDef(**vars(function))], [])
        return define(name, ast.unparse(ast.fix_missing_locations(module)))
    assert old in solution, (
        "the solution has changed: change this row of the table, too"
    )
    if old == "return":
        old = solution[solution.rindex("return ") + len("return ") :]
    return define(name, solution.replace(old, new))


COMPARE = ask.compare


class Comparisons:
    """Stands where a check compares numbers, and keeps what it compares with."""

    def __init__(self, name, monkeypatch):
        self.name = name
        self.kept = []
        module = sys.modules[getattr(checks, name).__module__]
        if hasattr(module, "expect"):
            monkeypatch.setattr(module, "expect", self)
        else:
            monkeypatch.setattr(ask, "compare", self.of_question)

    def of_question(self, found, question, rtol, atol):
        otherwise = question.otherwise
        if callable(otherwise):
            otherwise = otherwise(question.truth + 1000.0)

        def said_of(value):
            try:
                COMPARE(value, question, rtol, atol)
            except checks.CheckFailed as refused:
                return str(refused)
            return ""

        self.kept.append(
            (np.asarray(question.truth), otherwise, question.slips, said_of)
        )
        assert not said_of(found)

    def __call__(self, found, truth, otherwise, slips=None, *bounds, **tolerance):
        def said_of(value):
            try:
                expect(value, truth, otherwise, slips, *bounds, **tolerance)
            except checks.CheckFailed as refused:
                return str(refused)
            return ""

        self.kept.append((np.asarray(truth), otherwise, slips or {}, said_of))
        assert not said_of(found)

    def of_solution(self, seed):
        """Truth, what is said otherwise, slips, and what is said of a value."""
        self.kept.clear()
        getattr(checks, self.name)(
            define(self.name, EXERCISES[self.name][2]), seed=seed
        )
        return self.kept


@pytest.mark.slow
@pytest.mark.parametrize("name", EXERCISES)
def test_each_slip_that_a_check_knows_is_refused_and_named(name, monkeypatch):
    """Whatever is drawn.

    A check may compare several times, and a slip gives the truth in some of them, or
    what another slip gives: with one number, its mean is its sum. What is said of a
    slip then differs by the numbers in it.
    """
    comparisons = Comparisons(name, monkeypatch)
    for seed in DRAWS:
        known = set()
        named = set()
        for truth, otherwise, slips, said_of in comparisons.of_solution(seed):
            for words, slip in slips.items():
                kind = re.sub(r"[\d.]+", "#", words)
                known.add(kind)
                if said_of(slip) == words:
                    named.add(kind)
            assert said_of(truth + 1000.0) == otherwise
        assert named == known


@pytest.mark.parametrize(("name", "right", "wrong", "message"), SLIPS)
def test_a_slip_is_refused_and_named(name, right, wrong, message, capsys):
    with pytest.raises(checks.CheckFailed, match=re.escape(message)):
        getattr(checks, name)(replaced(name, right, wrong))
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(("name", "old", "new"), RIGHTS)
def test_another_way_to_be_right_is_accepted(name, old, new, capsys):
    getattr(checks, name)(replaced(name, old, new))
    assert capsys.readouterr().out == "correct\n"


def test_a_check_wants_the_function_itself():
    with pytest.raises(checks.CheckFailed, match="the function update itself"):
        checks.update(None)


def test_an_open_exercise_is_replaced_by_ours():
    _, stub, solution = EXERCISES["my_mask"]
    answered = define("my_mask", solution)
    assert checks.if_open(define("my_mask", stub), len) is len
    assert checks.if_open(answered, len) is answered


def test_dots_of_an_index_are_an_answer_and_dots_in_one_line_are_none():
    source = EXERCISES["my_mask"][1].replace("...", "...  # 1 where")
    with pytest.raises(Unanswered, match=r"in `return \.\.\.`$"):
        checks.my_mask(define("my_mask", source))
    checks.my_mask(
        replaced(
            "my_mask",
            "return",
            "np.array([int(k % settings.period == 0) for k in steps])[...]",
        )
    )


class Replay:
    """Returns what another answer returned, call for call, as one who writes down the
    outputs of a run would.
    """

    def __init__(self, answer):
        self.answer, self.recorded = answer, []

    def record(self, *args, **kwargs):
        found = self.answer(*args, **kwargs)
        self.recorded.append(copy.deepcopy(found))
        return found

    def __call__(self, *args, **kwargs):
        return self.recorded.pop(0)


@pytest.mark.parametrize("name", EXERCISES)
def test_a_recorded_replay_of_outputs_fails(name, capsys):
    replay = Replay(define(name, EXERCISES[name][2]))
    getattr(checks, name)(replay.record, seed=1)
    first = list(replay.recorded)
    with pytest.raises(checks.CheckFailed):
        getattr(checks, name)(replay, seed=2)
    replay.recorded = first
    getattr(checks, name)(replay, seed=1)  # the replay itself is exact


def test_a_failure_names_the_call_that_repeats_it_and_the_environment_repeats_all(
    monkeypatch,
):
    def wrong(m, c, t):
        seen.append(t)
        return -np.ones(len(t))

    seen = []
    monkeypatch.delenv("CLOTHLAB_CHECK_SEED")
    with pytest.raises(checks.CheckFailed) as first:
        checks.falling_speed(wrong)
    line = first.value._render_traceback_()[1]
    seed = re.fullmatch(
        r"\(the same inputs again: checks\.falling_speed\(falling_speed, seed=(\d+)\)\)",
        line,
    )[1]
    with pytest.raises(checks.CheckFailed):
        checks.falling_speed(wrong, seed=int(seed))
    monkeypatch.setenv("CLOTHLAB_CHECK_SEED", seed)
    with pytest.raises(checks.CheckFailed):
        checks.falling_speed(wrong)
    assert np.array_equal(seen[0], seen[1])
    assert np.array_equal(seen[0], seen[2])


@pytest.mark.slow
@pytest.mark.parametrize("name", EXERCISES)
def test_whatever_is_drawn_solutions_pass_and_slips_are_named(name, capsys):
    right = [define(name, EXERCISES[name][2])]
    right += [replaced(name, old, new) for other, old, new in RIGHTS if other == name]
    slips = [
        (replaced(name, old, new), words)
        for other, old, new, words in SLIPS
        if other == name
    ]
    for seed in DRAWS:
        for answer in right:
            getattr(checks, name)(answer, seed=seed)
        for wrong, words in slips:
            with pytest.raises(checks.CheckFailed, match=re.escape(words)):
                getattr(checks, name)(wrong, seed=seed)


def random_like(found, rng):
    """Random numbers of the kind that an answer returns."""
    if isinstance(found, tuple):
        return tuple(random_like(part, rng) for part in found)
    if callable(found):
        return lambda *_, **__: rng.normal()
    shape = () if found is None else np.shape(found)
    return rng.normal(size=shape)


ODD = [None, "three", float("nan"), np.zeros((2, 2, 2, 2)), {"a": 1}]


@pytest.mark.parametrize("name", EXERCISES)
def test_random_numbers_and_what_is_no_number_are_refused_in_a_sentence(name, capsys):
    rng = np.random.default_rng(0)
    solution = define(name, EXERCISES[name][2])
    answers = [lambda *args, **kwargs: random_like(solution(*args, **kwargs), rng)]
    answers += [lambda *args, odd=odd, **kwargs: odd for odd in ODD]
    for answer in answers:
        with pytest.raises(checks.CheckFailed, match=r"\w \w") as refused:
            getattr(checks, name)(answer)
        assert "\n" not in str(refused.value)
        assert len(str(refused.value)) < 300
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "error",
    [AssertionError("no"), KeyError("p"), StopIteration(), RuntimeError("two\nlines")],
)
def test_every_error_of_an_answer_is_named(error):
    def answer(*args, **kwargs):
        raise error

    with pytest.raises(
        checks.CheckFailed,
        match=f"falling_speed raised {type(error).__name__}.*`raise error`",
    ):
        checks.falling_speed(answer)


def test_an_error_of_a_check_itself_is_not_taken_for_the_answers():
    @check(number("a number"))
    def faulty(answer, rng):
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
    def compare(answer, rng):
        answer(given)

    compare(lambda x: len(x))
    with pytest.raises(
        checks.CheckFailed, match="changes its argument `x` in place: work on a copy"
    ):
        compare(lambda x: bool(change(x) is x))


def test_an_answer_of_any_arguments_must_not_change_them_either():
    """Else what is right, computed of them afterwards, is whatever it made of them."""

    @check(number("a sum"))
    def compare(answer, rng):
        a, b = rng.normal(size=3), rng.normal(size=3)
        expect(answer(a, b), (a * b).sum(), "wrong")

    def emptied(*given):
        given[1][...] = 0
        return 0

    compare(lambda *given: (given[0] * given[1]).sum())
    with pytest.raises(checks.CheckFailed, match="changes its argument `given`"):
        compare(emptied)


@pytest.mark.parametrize(
    "found",
    [2, 2.0, np.float32(2), np.int64(2), np.array(2), torch.tensor(2.0), Fraction(2)],
)
def test_a_number_of_any_kind_is_a_number(found):
    assert number("a number")("f", found) == 2.0


@pytest.mark.parametrize(
    "found",
    [
        (1, 2),
        [True, 2],
        np.array([1, 2], np.float32),
        torch.tensor([1, 2]),
        range(1, 3),
    ],
)
def test_an_array_of_any_kind_is_an_array(found):
    assert array("two numbers", 2)("f", found).tolist() == [1.0, 2.0]
